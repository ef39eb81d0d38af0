"""What edits make of strands in any frame: worked out once at rest, then applied to each frame's strands."""

from __future__ import annotations

import torch
from jaxtyping import Float
from pykdtree.kdtree import KDTree
from torch import Tensor

from dynhair.editing.canonical_hair import CanonicalHair
from dynhair.editing.hair_look import HairLook
from dynhair.strands import segment_lengths


class EditedHair:
    """Strands that are left, cut where they are cut at rest.

    A cut strand has as many points as before, at equal steps of the arc length that is left of it at rest. They are
    points of the strand's own segments, the same ones in every frame, so that nothing slides along a strand that
    stretches. The network that moves the hair has moved whole strands before (paper, supplement, "Trimming").

    Args:
        hair: the canonical hair, after all edits.

    Attributes:
        look: of the strands that are left.
    """

    def __init__(self, hair: CanonicalHair) -> None:
        ids = hair.kept.nonzero()[:, 0]
        sizes = len(hair.strands), hair.strands.shape[1] - 1
        along = torch.nn.functional.pad(segment_lengths(hair.strands[ids]).cumsum(1), (1, 0))
        lengths = hair.lengths[ids, None]
        base, higher = (h.unflatten(2, sizes)[:, :, ids] for h in (hair.base_harmonic, hair.higher_harmonics))
        uncut = lengths >= along[:, -1:] * (1 - 1e-6)
        self._ids = None if len(ids) == len(hair.strands) else ids
        self._segments = self._shares = None
        if not uncut.all():
            steps = torch.linspace(0, 1, sizes[1] + 1, dtype=along.dtype, device=along.device)
            own = torch.arange(sizes[1], device=ids.device)
            # points between the ends of a segment, by their share; the colour is that of the segment amid two of them
            segments, shares = _places(along, lengths * steps)
            self._segments = torch.where(uncut, torch.cat([own, own[-1:]]), segments)
            self._shares = torch.where(uncut, (steps == 1).to(along), shares)[..., None]
            amid, _ = _places(along, lengths * (steps[1:] + steps[:-1]) / 2)
            amid = torch.where(uncut, own, amid)
            base, higher = (h.gather(3, amid.expand(*h.shape[:2], -1, -1)) for h in (base, higher))
        nearest = KDTree(hair.strands[ids, 0].cpu().numpy()).query(hair.strands[:, 0].cpu().numpy())[1]
        nearest = torch.from_numpy(nearest.astype("int64")).to(ids.device)
        nearest[ids] = torch.arange(len(ids), device=ids.device)  # also of several roots in one place
        self.look = HairLook(ids, nearest, hair.widths[ids], base.flatten(2), higher.flatten(2))

    def __call__(self, strands: Float[Tensor, "n l 3"]) -> Float[Tensor, "m l 3"]:
        """The strands that are left of all canonical ones in some frame, in any Cartesian frame of reference."""
        left = strands if self._ids is None else strands[self._ids]
        if self._segments is None or self._shares is None:
            return left
        index = self._segments[..., None].expand(-1, -1, 3)
        return torch.lerp(left.gather(1, index), left.gather(1, index + 1), self._shares)


def _places(along: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
    """The segments that lie at given arc lengths, and the places inside them from 0 to 1."""
    segments = torch.searchsorted(along, targets.contiguous(), right=True).sub_(1).clamp_(0, along.shape[1] - 2)
    start, end = along.gather(1, segments), along.gather(1, segments + 1)
    return segments, ((targets - start) / (end - start).clamp_min(1e-12)).clamp(0, 1)
