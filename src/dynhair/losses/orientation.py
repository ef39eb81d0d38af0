"""The hair's orientation in the image against orientation maps (paper, "Geometric losses")."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

COVERAGE = 0.5
"""Above which a pixel belongs to a hair mask."""


def orientation_loss(
    predicted: Float[Tensor, "*v h w"],
    target: Float[Tensor, "*v h w"],
    predicted_hair: Float[Tensor, "*v h w"],
    target_hair: Float[Tensor, "*v h w"],
    confidence: Float[Tensor, "*v h w"] | None = None,
) -> Float[Tensor, ""]:
    """The paper's wrap-aware ``L_orient``: mean angle between undirected orientations, radians.

    The angle is that to the nearest of the target and its equals, whole turns of pi away. The mean is taken where both
    masks say hair; the masks themselves get no gradient. Orientations decoded by
    :func:`dynhair.strands.decode_orientation` carry finite gradients back to the strands.

    Args:
        predicted: rendered orientation in [0, 1) of pi.
        target: orientation map in [0, 1) of pi.
        predicted_hair: rendered hair coverage in [0, 1].
        target_hair: hair mask in [0, 1].
        confidence: weight of each pixel of the target, not negative; one if not given.

    Returns:
        The weighted mean in [0, pi / 2]; zero where the masks do not meet.
    """
    weight = ((predicted_hair > COVERAGE) & (target_hair > COVERAGE)).to(predicted)
    if confidence is not None:
        weight = weight * confidence
    difference = predicted - target
    angle = (difference - difference.detach().round()).abs()
    return torch.pi * (weight * angle).sum() / weight.sum().clamp_min(torch.finfo(weight.dtype).tiny)
