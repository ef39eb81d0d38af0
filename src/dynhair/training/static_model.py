"""What the static stage optimises: the prior's encoders first, then the strands themselves, and the colours."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from pykdtree.kdtree import KDTree
from scipy.interpolate import BSpline
from torch import Tensor, nn

from dynhair.prior.evidence import Evidence
from dynhair.prior.hair_prior import HairPrior
from dynhair.strands import ScalpFrame

POINTS = 200
"""Points of a canonical strand (supplement B: "The obtained hair strands have 200 points")."""

_CONTROLS = 8
_STRANDS_PER_GUIDE = 12
_GUIDES = (16, 160)
_REACH = 0.03
_COLOUR_CONTROLS = 4
_DEVIATION = 0.5


class EncodedHair(nn.Module):
    """Hair that the prior's encoders make of the views; its parameters are the encoders'.

    Args:
        prior: not shared with anyone: it is trained on.
        evidence: what the views show.
        valid: texels of the scalp texture that lie on the scalp.
        frame: of the scalp.
        positions: of the roots, head frame, metres.
    """

    def __init__(
        self,
        prior: HairPrior,
        evidence: Evidence,
        valid: Bool[Tensor, "s s"],
        frame: ScalpFrame,
        positions: Float[Tensor, "n 3"],
    ) -> None:
        super().__init__()
        self.prior = prior
        self._evidence, self._valid, self._frame, self._positions = evidence, valid, frame, positions

    def forward(self, points: int) -> Float[Tensor, "n p 3"]:
        """Strands of that many points, head frame, metres."""
        return self.prior.strands(self.prior(self._evidence), self._valid, self._frame, self._positions, points)


class DisplacedHair(nn.Module):
    """Strands that move away from where they began, smoothly along their length.

    A strand is displaced by a cubic B-spline over its arc length that leaves the root in place: it cannot zigzag. The
    displacement is the sum of the strand's own and one shared with the strands beside it, interpolated from guides, so
    that strands which no view sees go along with those above them.

    Args:
        start: strands, head frame, metres.
    """

    start: Tensor
    guides: Tensor
    shares: Tensor

    def __init__(self, start: Float[Tensor, "n 200 3"]) -> None:
        super().__init__()
        guides, shares = _guides(start)
        self.register_buffer("start", start)
        # Both follow from the start, so that a checkpoint need not hold them.
        self.register_buffer("guides", guides, persistent=False)
        self.register_buffer("shares", shares, persistent=False)
        self.shared = nn.Parameter(torch.zeros(int(guides.max()) + 1, _CONTROLS, 3))
        self.own = nn.Parameter(torch.zeros(len(start), _CONTROLS, 3))

    def forward(self, points: int) -> Float[Tensor, "n p 3"]:
        """Strands of that many points at equal steps of the starting strands' arc length, head frame, metres."""
        controls = self.own + (self.shares[..., None, None] * self.shared[self.guides]).sum(1)
        basis = _basis(points).to(controls)
        return _at_equal_steps(self.start, points) + torch.einsum("lk,nkd->nld", basis, controls)


class Paint(nn.Module):
    """Colours of hair and body at rest, the same from every side.

    All strands share colours from root to tip; a strand's own deviate from them a little. Free colours would paint
    strands that hang before the face like skin, in the place of moving them away.

    Args:
        strands: their number.
        body: number of the body's Gaussians.
        hair_colour: initial colour in [0, 1].
        body_colour: initial colour in [0, 1].
    """

    def __init__(
        self, strands: int, body: int, hair_colour: Float[Tensor, "3"], body_colour: Float[Tensor, "3"]
    ) -> None:
        super().__init__()
        self.hair = nn.Parameter(hair_colour.repeat(_COLOUR_CONTROLS, 1))
        self.deviations = nn.Parameter(torch.zeros(strands, _COLOUR_CONTROLS, 1))
        self.body = nn.Parameter(body_colour.repeat(body, 1))

    def segments(self, count: int) -> Float[Tensor, "g 3"]:
        """Colours of ``count`` segments a strand, strand by strand."""
        controls = self.hair * (1 + _DEVIATION * torch.tanh(self.deviations))
        along = torch.nn.functional.interpolate(controls.transpose(1, 2), count, mode="linear", align_corners=True)
        return along.transpose(1, 2).flatten(0, 1)


def _at_equal_steps(strands: Float[Tensor, "n l 3"], points: int) -> Float[Tensor, "n p 3"]:
    place = torch.linspace(0, strands.shape[1] - 1, points, device=strands.device)
    below = place.long().clamp_max(strands.shape[1] - 2)
    return torch.lerp(strands[:, below], strands[:, below + 1], (place - below)[:, None])


def _basis(points: int) -> Float[Tensor, "l k"]:
    """Cubic B-splines on clamped, uniform knots at the strand's points, without the one that would move the root."""
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, _CONTROLS - 1), np.ones(3)])
    matrix = BSpline.design_matrix(np.linspace(0, 1, points), knots, 3).toarray()
    return torch.from_numpy(matrix[:, 1:]).float()


def _guides(strands: Float[Tensor, "n l 3"]) -> tuple[Int[Tensor, "n g"], Float[Tensor, "n g"]]:
    """For each strand the guides that it goes along with, and its shares in them.

    Roots come in random order, so that the first strands cover the scalp: they are the guides. Strands belong together
    that run side by side from root to tip; near roots alone would tie hair across the parting.
    """
    count = min(max(len(strands) // _STRANDS_PER_GUIDE, _GUIDES[0]), _GUIDES[1], len(strands))
    middle = strands.shape[1] // 2
    courses = np.ascontiguousarray(strands[:, [0, middle, -1]].flatten(1).numpy())
    distances, guides = KDTree(courses[:count]).query(courses, k=min(3, count))
    distances = torch.from_numpy(np.asarray(distances)).reshape(len(strands), -1)
    shares = torch.softmax(-distances.square() / _REACH**2, dim=1)
    return torch.from_numpy(np.asarray(guides).astype(np.int64)).reshape(len(strands), -1), shares
