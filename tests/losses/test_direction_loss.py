"""The smooth form of the orientation loss against a loop that decodes the angles."""

from __future__ import annotations

import cmath
import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.losses import direction_loss

SHAPE = (2, 5, 6)


def maps(seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Predicted doubled angles times coverage, coverage, and target doubled angles times coherence."""
    generator = torch.Generator().manual_seed(seed)
    angles = torch.rand(2, *SHAPE, generator=generator, dtype=torch.float64) * 2 * torch.pi
    coverage, coherence, blended = torch.rand(3, *SHAPE, generator=generator, dtype=torch.float64)
    predicted, target = torch.stack([angles.cos(), angles.sin()], -1)
    return predicted * (coverage * blended)[..., None], coverage, target * coherence[..., None]


def test_directions_agree_with_a_loop() -> None:
    predicted, coverage, target = maps()
    total = weights = 0.0
    for p, c, t in zip(
        predicted.reshape(-1, 2).tolist(), coverage.flatten().tolist(), target.reshape(-1, 2).tolist(), strict=True
    ):
        found, known = complex(*p), complex(*t)
        difference = (cmath.phase(found) - cmath.phase(known)) / 2
        # what is blended from strands that disagree counts as halfway between agreement and its opposite
        agreement = abs(found) / (c + 1e-3) * math.cos(2 * difference)
        total += abs(known) * c * (1 - agreement) / 2
        weights += abs(known) * c
    assert direction_loss(predicted, coverage, target).item() == pytest.approx(total / weights)


@given(st.floats(0, math.pi), st.floats(0, math.pi))
def test_it_is_the_squared_sine_of_the_angle(a: float, b: float) -> None:
    first, second = (torch.tensor([math.cos(2 * x), math.sin(2 * x)]).double().expand(2, 2, 2) for x in (a, b))
    loss = direction_loss(first, torch.ones(2, 2, dtype=torch.float64), second)
    assert loss.item() == pytest.approx(math.sin(a - b) ** 2, abs=1e-3)


def test_the_weight_of_coverage_gets_no_gradient() -> None:
    predicted, coverage, target = maps(1)
    assert torch.autograd.gradcheck(lambda p: direction_loss(p, coverage, target), predicted.requires_grad_())
    weight = coverage.clone().requires_grad_()
    direction_loss(torch.zeros_like(predicted), weight, target).backward()  # no agreement that coverage could scale
    assert weight.grad is not None
    assert weight.grad.abs().max() == 0


def test_nothing_to_compare_costs_nothing() -> None:
    predicted, coverage, target = maps(2)
    for hair, known in ((torch.zeros_like(coverage), target), (coverage, torch.zeros_like(target))):
        doubled = (predicted * hair[..., None]).requires_grad_()
        loss = direction_loss(doubled, hair, known)
        loss.backward()
        assert loss.item() == 0
        assert doubled.grad is not None
        assert doubled.grad.abs().max() == 0
