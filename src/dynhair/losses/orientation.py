"""The hair's orientation in the image against orientation maps (paper, "Geometric losses")."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.losses.differences import added_up

COVERAGE = 0.5
"""Above which a pixel belongs to a hair mask."""

_NEGLIGIBLE_COVERAGE = 1e-3


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
    weight = orientation_weight(predicted_hair, target_hair, confidence)
    angles = added_up(predicted, target, weight=weight, turns=True)
    return torch.pi * angles / weight.sum().clamp_min(torch.finfo(weight.dtype).tiny)


def orientation_weight(
    predicted_hair: Float[Tensor, "*v h w"],
    target_hair: Float[Tensor, "*v h w"],
    confidence: Float[Tensor, "*v h w"] | None = None,
) -> Float[Tensor, "*v h w"]:
    """How far each pixel counts in `orientation_loss`, whose arguments these are; without a gradient."""
    weight = ((predicted_hair > COVERAGE) & (target_hair > COVERAGE)).to(predicted_hair)
    return weight if confidence is None else weight * confidence


def direction_loss(
    predicted: Float[Tensor, "*v h w 2"], coverage: Float[Tensor, "*v h w"], target: Float[Tensor, "*v h w 2"]
) -> Float[Tensor, ""]:
    """Mean squared sine of the angle between undirected orientations, weighted by the target's coherence.

    It is ``(1 - cos 2d) / 2`` for angles that differ by ``d``: a smooth form of ``L_orient`` that decodes no angles, so
    that strands which are far off still feel a finite and steady pull.

    Args:
        predicted: rendered doubled angles ``(cos 2a, sin 2a)`` times the hair's coverage.
        coverage: rendered hair coverage in [0, 1]; it weighs the pixels and gets no gradient through the weight.
        target: doubled angles times their coherence in [0, 1]; zeros where nothing is known.

    Returns:
        The weighted mean in [0, 1]; zero where the two do not meet.
    """
    weight = target.norm(dim=-1) * coverage.detach()
    known = torch.nn.functional.normalize(target, dim=-1)
    agreement = (predicted * known).sum(-1) / (coverage + _NEGLIGIBLE_COVERAGE)
    return (weight * (1 - agreement)).sum() / (2 * weight.sum().clamp_min(1.0))
