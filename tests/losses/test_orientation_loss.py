"""The orientation loss against the paper's formula in a loop, and its way back to the strands."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.losses import orientation_loss
from dynhair.strands import decode_orientation

SHAPE = (2, 5, 6)


def maps(seed: int = 0) -> list[torch.Tensor]:
    """Predicted and target orientation, predicted and target hair, confidence."""
    generator = torch.Generator().manual_seed(seed)
    return list(torch.rand(5, *SHAPE, generator=generator, dtype=torch.float64))


def test_orientation_agrees_with_a_loop() -> None:
    predicted, target, hair, mask, confidence = maps()
    weighted = plain = weights = count = 0.0
    for p, t, h, m, c in zip(
        *(image.flatten().tolist() for image in (predicted, target, hair, mask, confidence)), strict=True
    ):
        if h > 0.5 and m > 0.5:
            angle = math.pi * min(abs(p - t), abs(p - t - 1), abs(p - t + 1))
            plain, count = plain + angle, count + 1
            weighted, weights = weighted + c * angle, weights + c
    assert orientation_loss(predicted, target, hair, mask).item() == pytest.approx(plain / count)
    assert orientation_loss(predicted, target, hair, mask, confidence).item() == pytest.approx(weighted / weights)


@given(st.floats(0, 1, exclude_max=True), st.floats(0, 1, exclude_max=True))
def test_orientation_wraps(a: float, b: float) -> None:
    ones = torch.ones(1, 1, dtype=torch.float64)
    loss = orientation_loss(a * ones, b * ones, ones, ones)
    torch.testing.assert_close(orientation_loss((a + 1) * ones, b * ones, ones, ones), loss)
    torch.testing.assert_close(orientation_loss(b * ones, a * ones, ones, ones), loss)
    assert loss.item() == pytest.approx(math.asin(min(abs(math.sin(math.pi * (a - b))), 1)), abs=1e-6)


def test_the_gradient_turns_the_short_way_round() -> None:
    predicted, ones = torch.tensor([[0.98]], requires_grad=True), torch.ones(1, 1)
    orientation_loss(predicted, 0.02 * ones, ones, ones).backward()
    assert predicted.grad is not None
    assert predicted.grad.item() == pytest.approx(-math.pi)  # a step downhill takes 0.98 up to 1, which is 0


@pytest.mark.parametrize("confidence", [None, torch.zeros(SHAPE)])
def test_nothing_to_compare_costs_nothing(confidence: torch.Tensor | None) -> None:
    predicted = torch.rand(SHAPE, requires_grad=True)
    hair = torch.zeros(SHAPE) if confidence is None else torch.ones(SHAPE)
    loss = orientation_loss(predicted, torch.rand(SHAPE), hair, torch.ones(SHAPE), confidence)
    loss.backward()
    assert loss.item() == 0
    assert predicted.grad is not None
    assert torch.equal(predicted.grad, torch.zeros(SHAPE))


def test_gradients_agree_with_finite_differences_through_doubled_angles() -> None:
    generator = torch.Generator().manual_seed(3)
    doubled = torch.randn(*SHAPE, 2, generator=generator, dtype=torch.float64, requires_grad=True)
    _, target, _, mask, confidence = maps(3)
    ones = torch.ones(SHAPE, dtype=torch.float64)
    assert torch.autograd.gradcheck(
        lambda d: orientation_loss(decode_orientation(d), target, ones, mask, confidence), doubled
    )


def test_gradients_are_finite_where_blended_orientations_cancel_out() -> None:
    doubled = torch.zeros(*SHAPE, 2, requires_grad=True)
    ones = torch.ones(SHAPE)
    orientation_loss(decode_orientation(doubled), 0.3 * ones, ones, ones).backward()
    assert doubled.grad is not None
    assert doubled.grad.isfinite().all()
