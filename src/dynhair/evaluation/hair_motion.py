"""How much of the truth's hair motion an avatar explains.

Both hairs are compared in the head's frame, where a rigid hairstyle stands still. For frame t, point p of the truth's
strands and the avatar's points N(p) that are nearest to it at rest,

    g_tp = x_tp - x_0p                                      the truth's displacement from rest
    d_tp = sum over q in N(p) of w_pq (y_tq - y_0q)         the avatar's, from its canonical strands
    w_pq proportional to 1 / |x_0p - y_0q|, summing to 1    (Shepard 1968)
    explained = 1 - mean_tp |d_tp - g_tp| / mean_tp |g_tp|

1 is the truth's motion and 0 is what a rigid hairstyle scores; a motion that is worse than none is negative. The
weights matter: with plain means the truth's own strands would fall short of 1, as strands close to each other at rest
part in motion. The tips, which swing furthest, are also told apart: the avatar sees the tip x_0p at x_0p + d_tp.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from torch import Tensor

NEAREST_POINTS = 4
"""Points of the avatar's strands whose displacements are blended at a point of the truth."""

LEAST_DISTANCE = 1e-9
"""Metres; closer points count as one, and the avatar's displacement is taken as it is."""

LEAST_MOTION = 1e-6
"""Metres of mean displacement below which the truth's hair stands still, so that nothing is there to explain."""


def to_head_frame(
    world: Float[Tensor, "*n 3"], rotation: Float[Tensor, "3 3"], translation: Float[Tensor, "3"]
) -> Float[Tensor, "*n 3"]:
    """World points in the head's frame, ``x_head = R^T (x_world - T)``, metres."""
    return (world - translation) @ rotation


def nearest_points(
    points: Float[Tensor, "n 3"], queries: Float[Tensor, "m 3"], count: int
) -> tuple[Int[Tensor, "m k"], Float[Tensor, "m k"]]:
    """Find the ``count`` points (all, if there are fewer) nearest to each query.

    Returns:
        Their indices, and weights that fall off with the inverse of the distance and sum to 1.
    """
    distances, indices = KDTree(points.numpy()).query(queries.numpy(), k=min(count, len(points)))
    weights = 1.0 / torch.as_tensor(distances).reshape(len(queries), -1).clamp_min(LEAST_DISTANCE)
    nearest = torch.as_tensor(indices, dtype=torch.int64).reshape(len(queries), -1)
    return nearest, weights / weights.sum(dim=1, keepdim=True)


class HairMotion:
    """Compares displacements from rest, all in the head's frame and metres.

    Args:
        rest: the avatar's strands at rest: canonical, as a rigid hairstyle wears them.
        truth_rest: the truth's strands at rest.
        nearest: how many of the avatar's points are blended at a point of the truth.

    Attributes:
        true_strands: number of the truth's strands.
        true_points: points of each.
    """

    def __init__(
        self,
        rest: Float[Tensor, "n l 3"],
        truth_rest: Float[Tensor, "m p 3"],
        *,
        nearest: int = NEAREST_POINTS,
    ) -> None:
        self.true_strands, self.true_points = truth_rest.shape[:2]
        self._rest = _points(rest)
        self._truth_rest = _points(truth_rest)
        self._nearest, self._weights = nearest_points(self._rest, self._truth_rest, nearest)

    def errors(self, strands: Float[Tensor, "n l 3"], truth: Float[Tensor, "m p 3"]) -> tuple[float, float]:
        """Means over the truth's points in one frame: the avatar's error ``|d - g|``, and a rigid hairstyle's ``|g|``.

        Args:
            strands: the avatar's, deformed.
            truth: the truth's strands in the same frame.
        """
        true_displacement = _points(truth) - self._truth_rest
        error = (self._displacements(strands, slice(None)) - true_displacement).norm(dim=-1).mean()
        return error.item(), true_displacement.norm(dim=-1).mean().item()

    def tips(self, strands: Float[Tensor, "n l 3"]) -> Float[Tensor, "m 3"]:
        """Where the avatar's hair takes the truth's tips from rest, metres.

        Args:
            strands: the avatar's, deformed.
        """
        tips = slice(self.true_points - 1, None, self.true_points)
        return self._truth_rest[tips] + self._displacements(strands, tips)

    def _displacements(self, strands: Float[Tensor, "n l 3"], places: slice) -> Float[Tensor, "q 3"]:
        """The avatar's displacements, blended at these of the truth's points."""
        near = (_points(strands) - self._rest)[self._nearest[places]]
        return (self._weights[places, :, None] * near).sum(dim=1)


def tip_error_mm(tips: Float[Tensor, "m 3"], truth: Float[Tensor, "m 3"]) -> float:
    """Mean distance of the avatar's tips from the truth's in one frame, millimetres.

    Args:
        tips: as `HairMotion.tips` sees them, metres.
        truth: the tips of the truth's strands, in the same frame and the head's frame, metres.
    """
    return 1e3 * (tips - truth).norm(dim=-1).mean().item()


def motion_explained(error: float, rigid_error: float) -> float:
    """``1 - error / rigid_error`` for means over frames, metres; ``nan`` where the truth's hair stands still."""
    return 1.0 - error / rigid_error if rigid_error > LEAST_MOTION else math.nan


def _points(strands: Float[Tensor, "n l 3"]) -> Float[Tensor, "q 3"]:
    return strands.detach().cpu().double().reshape(-1, 3)
