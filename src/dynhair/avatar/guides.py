"""Guide strands: what a few of them have is blended over all."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import embedding_bag

from dynhair.strands.spreading import farthest_points

NEAREST = 4
"""Guides that a strand follows."""

SOFTNESS = 0.005
"""Metres, far below the distance of guides: a strand that is as near as this to one still follows others, a little."""


class GuideBlend(nn.Module):
    """Blends what guides have over all strands.

    Guides are spread evenly through the hair, hidden hair included. A strand has a mean of what its nearest guides
    have, by weights that fall off with the square of the distance between courses.

    Args:
        strands: at rest, metres; their courses tell which are near.
        count: guides; all strands, if there are fewer.
    """

    nearest: Tensor
    weights: Tensor

    def __init__(self, strands: Float[Tensor, "n k 3"], count: int) -> None:
        super().__init__()
        guides = farthest_points(strands.mean(1), count)
        courses = strands.flatten(1)
        # root mean square distance of corresponding points
        distances = torch.cdist(courses, courses[guides]) / strands.shape[1] ** 0.5
        distances, nearest = distances.topk(min(NEAREST, len(guides)), largest=False)
        weights = 1 / (distances.square() + SOFTNESS**2)
        self.count = len(guides)
        self.register_buffer("nearest", nearest)
        self.register_buffer("weights", weights / weights.sum(1, keepdim=True))

    def forward(self, values: Float[Tensor, "g c"]) -> Float[Tensor, "n c"]:
        """What the strands have, given what the guides have; differentiable in that."""
        return embedding_bag(self.nearest, values, per_sample_weights=self.weights, mode="sum")
