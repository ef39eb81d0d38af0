"""A hairstyle that follows a few guides."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from pykdtree.kdtree import KDTree
from torch import Tensor

NEAREST_GUIDES = 10
"""Guides that a strand follows (paper, supplement, "Baselines": k = 10)."""

LEAST_DISTANCE = 1e-9  # metres; roots that are closer than that are one


def spread_guides(roots: Float[Tensor, "n 3"], count: int) -> Int[Tensor, " g"]:
    """Choose guides all over the scalp: each one is the root farthest from those before it.

    Args:
        roots: of all strands, metres.
        count: how many; all if there are fewer.
    """
    chosen = [int((roots - roots.mean(0)).norm(dim=1).argmax())]
    distance = (roots - roots[chosen[0]]).norm(dim=1)
    for _ in range(min(count, len(roots)) - 1):
        chosen.append(int(distance.argmax()))
        distance = torch.minimum(distance, (roots - roots[chosen[-1]]).norm(dim=1))
    return torch.tensor(chosen)


def resampled(strands: Float[Tensor, "*b n l 3"], points: int) -> Float[Tensor, "*b n m 3"]:
    """Strands of another number of points, evenly spaced along the old ones, linearly between."""
    length = strands.shape[-2]
    place = torch.linspace(0, length - 1, points, dtype=strands.dtype, device=strands.device)
    before = place.floor().long().clamp(max=length - 2)
    share = (place - before)[:, None]
    return torch.lerp(strands[..., before, :], strands[..., before + 1, :], share)


class GuideInterpolation:
    """Strands that are displaced with the guides whose roots are nearest.

    A strand's displacement is a mean of the guides' with weights that fall off with the inverse of the roots' distance,
    so that a guide's own strand follows that guide alone, and guides at rest leave the hairstyle as it is.

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

    def __call__(self, displacements: Float[Tensor, "g m 3"]) -> Float[Tensor, "n l 3"]:
        """The strands, given what the guides' points have moved by since rest, head frame, metres."""
        moved = resampled(displacements.to(self.rest), self.rest.shape[1])
        return self.rest + (self.weights[..., None, None] * moved[self.nearest]).sum(1)
