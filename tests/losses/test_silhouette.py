"""The asymmetric silhouette loss and the schedule of its weight."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.losses import segmentation_loss, segmentation_weight


def masks(seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    predicted, target = torch.rand(2, 2, 5, 6, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return predicted, target


def test_segmentation_agrees_with_a_loop() -> None:
    predicted, target = masks()
    total = 0.0
    for p, t in zip(predicted.flatten().tolist(), target.flatten().tolist(), strict=True):
        total += max(t - p, 0) + 0.5 * max(p - t, 0)
    assert segmentation_loss(predicted, target).item() == pytest.approx(total / predicted.numel())


def test_missing_hair_costs_twice_as_much_as_excess() -> None:
    none, full = torch.zeros(4, 4), torch.ones(4, 4)
    assert segmentation_loss(none, full).item() == 1
    assert segmentation_loss(full, none).item() == 0.5
    assert segmentation_loss(full, none, excess=0.25).item() == 0.25


def test_segmentation_gradients_agree_with_finite_differences() -> None:
    predicted, target = masks(1)
    assert torch.autograd.gradcheck(segmentation_loss, (predicted.requires_grad_(), target))


def test_the_weight_follows_its_published_schedule() -> None:
    """x 0.85 every 20,000 steps after 20,000 of 320,000, and never below a half."""
    assert segmentation_weight(0, 320_000) == 1
    assert segmentation_weight(20_000, 320_000) == 1
    assert segmentation_weight(40_000, 320_000) == pytest.approx(0.85)
    assert segmentation_weight(50_000, 320_000) == pytest.approx(0.85**1.5)
    assert segmentation_weight(320_000, 320_000) == 0.5


def test_the_schedule_is_adjustable() -> None:
    assert segmentation_weight(50, 100, 0.5, 0.1) == 1
    assert segmentation_weight(75, 100, 0.5, 0.1, decay=0.5, period=0.25) == pytest.approx(0.5)
    assert segmentation_weight(100, 100, 0.5, 0.4, decay=0.5, period=0.25) == pytest.approx(0.4)


@given(st.integers(1, 10_000), st.floats(0, 1), st.floats(0, 1))
def test_the_weight_never_grows_and_stays_between_floor_and_one(iterations: int, warmup: float, floor: float) -> None:
    steps = range(0, iterations + 1, max(iterations // 20, 1))
    weights = [segmentation_weight(step, iterations, warmup, floor) for step in steps]
    assert weights[0] == 1
    assert all(floor <= weight <= 1 for weight in weights)
    assert weights == sorted(weights, reverse=True)
