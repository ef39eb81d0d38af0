"""A hairstyle that follows a few guides."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from pykdtree.kdtree import KDTree
from torch import Tensor

from dynhair.strands import bending_angles, segment_lengths, smooth_strands

NEAREST_GUIDES = 10
"""Guides that a strand follows (paper, supplement, "Baselines": k = 10)."""

LARGEST_BEND = 1.0  # radians, between neighbouring segments of a guide
SMOOTHINGS = 100  # more than a guide of a few dozen points needs to be straight

LEAST_DISTANCE = 1e-9  # metres; roots that are closer than that are one


def unkinked(guides: Float[Tensor, "g m 3"]) -> Float[Tensor, "g m 3"]:
    """Guides without sharp bends: those that have any are smoothed until they have none, roots and tips kept.

    A strand that folds back on itself cannot be a cable: at a bend of half a turn it may unbend to any side, and the
    solver finds none.
    """
    guides = guides.clone()
    for _ in range(SMOOTHINGS):
        kinked = bending_angles(guides).amax(1) > LARGEST_BEND
        if not kinked.any():
            break
        guides[kinked] = smooth_strands(guides[kinked])
    return guides


class GuideInterpolation:
    """Strands that are displaced with the guides whose roots are nearest.

    A strand's displacement is a mean of the guides', at the same share of their length, with weights that fall off with
    the inverse of the roots' distance: a guide's own strand follows that guide alone, and guides at rest leave the
    hairstyle as it is.

    Args:
        strands: at rest, head frame, metres.
        guides: which of them are guides.
        nearest: how many guides a strand follows; all, if there are fewer.

    Attributes:
        nearest: the guides of each strand, as places in ``guides``.
        weights: of these; not negative, summing to 1.
    """

    def __init__(
        self, strands: Float[Tensor, "n l 3"], guides: Int[Tensor, " g"], nearest: int = NEAREST_GUIDES
    ) -> None:
        self.rest = strands
        roots = strands[:, 0].detach().cpu().double()
        distance, found = KDTree(roots[guides].numpy()).query(roots.numpy(), k=min(nearest, len(guides)))
        distance = torch.from_numpy(distance).reshape(len(roots), -1)
        weights = 1.0 / distance.clamp_min(LEAST_DISTANCE)
        weights = torch.where(distance[:, :1] < LEAST_DISTANCE, (distance < LEAST_DISTANCE).double(), weights)
        self.nearest = torch.from_numpy(found.astype("int64")).reshape(len(roots), -1).to(strands.device)
        self.weights = (weights / weights.sum(1, keepdim=True)).to(strands)
        along = torch.nn.functional.pad(segment_lengths(strands.detach()).cumsum(1), (1, 0))
        self._share = along / along[:, -1:].clamp_min(LEAST_DISTANCE)  # of its strand's length, up to each point

    def __call__(self, displacements: Float[Tensor, "g m 3"]) -> Float[Tensor, "n l 3"]:
        """The strands, given the guides' displacements.

        Args:
            displacements: what points at equal steps along each guide have moved by since rest, head frame, metres.
        """
        followed = (self.weights[..., None, None] * displacements.to(self.rest)[self.nearest]).sum(1)
        place = self._share * (displacements.shape[1] - 1)
        before = place.long().clamp(max=displacements.shape[1] - 2)
        index = before[..., None].expand(-1, -1, 3)
        return self.rest + torch.lerp(
            followed.gather(1, index), followed.gather(1, index + 1), (place - before)[..., None]
        )
