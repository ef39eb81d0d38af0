"""Natural splines along a strand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from dynhair.avatar.splines import evenly_spaced, natural_spline
from dynhair.errors import DynhairError


@given(st.integers(2, 60), st.integers(2, 70))
def test_knots_are_spread_from_root_to_tip(points: int, count: int) -> None:
    knots = evenly_spaced(points, count)
    assert len(knots) == min(points, count)
    assert (knots[0], knots[-1]) == (0, points - 1)
    steps = knots.diff()
    assert steps.min() >= 1
    assert steps.max() - steps.min() <= 1


def test_no_knots_mean_every_point() -> None:
    assert evenly_spaced(9, 0).tolist() == list(range(9))
    assert torch.equal(natural_spline(evenly_spaced(9, 0), 9), torch.eye(9, dtype=torch.float64))


@pytest.mark.parametrize("count", [-1, 1])
def test_too_few_knots_are_refused(count: int) -> None:
    with pytest.raises(DynhairError, match="knots"):
        evenly_spaced(9, count)


@given(st.integers(3, 40), st.integers(2, 12), st.integers(0, 1000))
def test_the_spline_keeps_its_knots_and_straight_lines(points: int, count: int, seed: int) -> None:
    knots = evenly_spaced(points, count)
    matrix = natural_spline(knots, points)
    values = torch.randn(len(knots), 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    torch.testing.assert_close((matrix @ values)[knots], values)
    line = torch.arange(points, dtype=torch.float64)
    torch.testing.assert_close(matrix @ (2 * line[knots] - 5), 2 * line - 5)


def test_no_other_curve_through_the_knots_bends_less() -> None:
    """Among all twice differentiable interpolants the natural spline has the least integral of f''^2."""
    knots = evenly_spaced(24, 6)
    values = np.random.default_rng(0).normal(size=6)
    curve = natural_spline(knots, 24).numpy() @ values

    def bending(ends: str) -> float:
        second = CubicSpline(knots.numpy(), values, bc_type=ends).derivative(2)
        return quad(lambda x: float(second(x)) ** 2, 0, 23, limit=200)[0]

    dense = CubicSpline(np.arange(24), curve, bc_type="natural").derivative(2)
    own = quad(lambda x: float(dense(x)) ** 2, 0, 23, limit=400)[0]
    assert own == pytest.approx(bending("natural"), rel=1e-6)
    assert own < min(bending("not-a-knot"), bending("clamped"))
