"""Points on curves, from their control points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BPoly, BSpline

from dynhair.errors import DynhairError
from dynhair.strands.files.curves import Curves, joined_curves, on_curve


def control_points(count: int) -> np.ndarray:
    return np.random.default_rng(count).normal(size=(count, 3))


def test_bezier_handles_give_way_to_thirds_of_their_pieces() -> None:
    counts = np.array([4, 10])
    points = control_points(14)
    found = on_curve(points, counts, "bezier")
    for start in (0, 4, 7, 10):
        piece = BPoly(points[start : start + 4, None], [0, 3])
        np.testing.assert_allclose(found[start : start + 4], piece(np.arange(4)), atol=1e-12)


def test_inner_points_of_uniform_splines_are_their_values_at_the_knots() -> None:
    points = control_points(6)
    found = on_curve(points, np.array([6]), "bspline")
    spline = BSpline(np.arange(-3.0, 7), points, 3)
    np.testing.assert_allclose(found[1:-1], spline(np.arange(4)), atol=1e-12)
    np.testing.assert_array_equal(found[[0, -1]], points[[0, -1]])


@pytest.mark.parametrize("basis", ["linear", "catmullRom", "bspline"])
def test_curves_of_one_or_two_points_stay_as_they_are(basis: str) -> None:
    points = control_points(3)
    np.testing.assert_array_equal(on_curve(points, np.array([1, 2]), basis), points)


@pytest.mark.parametrize(
    ("widths", "expected"),
    [([2], [4, 4, 4, 4, 4]), ([1, 2], [2, 2, 4, 4, 4]), ([1, 2, 3, 4, 5], [2, 4, 6, 8, 10]), ([1, 2, 3], None)],
)
def test_widths_are_of_the_object_the_curves_or_the_points(widths: list[float], expected: list[float] | None) -> None:
    curves = Curves(np.zeros((5, 3)), np.array([2, 3]), "linear", np.array(widths), np.diag([2.0, -2, 2, 1]))
    found = joined_curves(Path("scene"), [curves]).widths
    assert (found.tolist() if found is not None else None) == expected


@pytest.mark.parametrize(
    ("found", "counts", "basis"),
    [
        ("no curves in it", [], "linear"),
        ("2 curves of 2 to 2 points are not their 5 points", [2, 2], "linear"),
        ("3 curves of -1 to 4 points", [4, 2, -1], "linear"),
        ("2 curves of 0 to 5 points", [0, 5], "linear"),
        ("bezier of 5 to 5 control points", [5], "bezier"),
        ("hermite of 5 to 5 control points", [5], "hermite"),
    ],
)
def test_impossible_curves_are_refused(found: str, counts: list[int], basis: str) -> None:
    curves = Curves(np.zeros((5, 3)), np.array(counts, np.int64), basis, None, np.eye(4))
    with pytest.raises(DynhairError, match=found):
        joined_curves(Path("scene"), [curves])
