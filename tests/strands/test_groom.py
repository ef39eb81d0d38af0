"""The parametric groom around a sphere."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.strands import segment_lengths, strand_lengths
from dynhair.strands.groom import GroomParameters, cut, grow_strands, hem_lengths, push_out

RADIUS = 0.09
DOWN = torch.tensor([0.0, -1.0, 0.0])


class Ball:
    """A head with exact distances."""

    def query(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        length = points.norm(dim=1, keepdim=True).clamp_min(1e-9)
        return length[:, 0] - RADIUS, points / length * RADIUS


def roots(count: int = 60) -> torch.Tensor:
    """Points on the upper part of the ball."""
    x = torch.randn(8 * count, 3, generator=torch.Generator().manual_seed(0))
    x = torch.nn.functional.normalize(x, dim=1)
    return x[x[:, 1] > 0.4][:count] * RADIUS


def grow(parameters: GroomParameters, points: int = 24, gravity: torch.Tensor = DOWN) -> torch.Tensor:
    start = roots()
    return grow_strands(parameters, start, start / RADIUS, Ball(), points, gravity)


def test_strands_leave_their_roots_in_equal_segments() -> None:
    strands = grow(GroomParameters())
    torch.testing.assert_close(strands[:, 0], roots())
    segments = segment_lengths(strands)
    assert (segments.amax(1) / segments.amin(1)).max() < 1.1


def test_strands_stay_outside_and_fall() -> None:
    strands = grow(GroomParameters(length=0.4, hem=0.5))
    assert strands[:, 1:].norm(dim=-1).min() > RADIUS - 1e-3
    assert (strands[:, -1, 1] < strands[:, 0, 1] - 0.1).all()


def test_hair_is_combed_away_from_the_parting() -> None:
    parted = GroomParameters(parting=0.02, lift=0.005, sweep=0.0)
    strands, start = grow(parted), roots()
    front = start[:, 2] > start[:, 2].mean()
    right = front & (start[:, 0] > 0.04)
    left = front & (start[:, 0] < 0.0)
    quarter = strands.shape[1] // 4
    assert right.any()
    assert left.any()
    assert (strands[right, quarter, 0] > start[right, 0]).all()
    assert (strands[left, quarter, 0] < start[left, 0]).all()


def test_no_strand_hangs_below_the_hem_or_is_longer_than_the_longest() -> None:
    strands = grow(GroomParameters(length=0.6, hem=0.2))
    assert strands[..., 1].min() > roots()[:, 1].max() - 0.2 - 2e-3
    assert strand_lengths(grow(GroomParameters(length=0.15, hem=1.0))).max() < 0.15 + 1e-5


def test_gravity_may_point_anywhere() -> None:
    sideways = grow(GroomParameters(length=0.4, hem=1.0), gravity=torch.tensor([3.0, 0.0, 0.0]))
    assert (sideways[:, -1, 0] > sideways[:, 0, 0] + 0.1).all()


@given(
    length=st.floats(0.05, 0.7),
    lift=st.floats(0.0, 0.03),
    sweep=st.floats(-1, 3),
    fall=st.floats(0.0, 0.2),
    flare=st.floats(-0.2, 0.5),
)
def test_any_style_is_finite(length: float, lift: float, sweep: float, fall: float, flare: float) -> None:
    style = replace(GroomParameters(), length=length, lift=lift, sweep=sweep, fall=fall, flare=flare)
    assert torch.isfinite(grow(style, points=8)).all()


def test_hem_lengths_of_straight_strands() -> None:
    falling = torch.stack([torch.zeros(11), torch.linspace(0, -1, 11), torch.zeros(11)], 1)
    courses = torch.stack([falling, falling + torch.tensor([0, 0.25, 0]), -falling])
    lengths = hem_lengths(courses, 0.5, DOWN)
    torch.testing.assert_close(lengths, torch.tensor([0.25, 0.5, 1.0]), atol=1e-4, rtol=0)


def test_cutting_a_straight_strand() -> None:
    course = torch.tensor([[[0.0, 0, 0], [0, -0.3, 0], [0, -1.0, 0]]])
    expected = torch.tensor([0, -0.2, -0.4, -0.6])
    torch.testing.assert_close(cut(course, torch.tensor([0.6]), 4)[0, :, 1], expected)


@pytest.mark.parametrize("clearance", [0.0, 0.01])
def test_points_are_pushed_straight_out(clearance: float) -> None:
    points = torch.tensor([[0.05, 0, 0], [0, -0.089, 0], [0, 0, 0.2]])
    expected = torch.tensor([[RADIUS + clearance, 0, 0], [0, -RADIUS - clearance, 0], [0, 0, 0.2]])
    torch.testing.assert_close(push_out(points, Ball(), clearance), expected, atol=1e-6, rtol=0)
