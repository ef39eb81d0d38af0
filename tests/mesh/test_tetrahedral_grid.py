"""Tetrahedra that fill a box without gaps."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import pytest
import torch
from closed_surfaces import cube
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.mesh import TetrahedralGrid

sides = st.floats(0.01, 3.0)


def volumes(grid: TetrahedralGrid) -> torch.Tensor:
    a, b, c, d = grid.vertices[grid.tetrahedra].unbind(1)
    return (torch.linalg.cross(b - a, c - a) * (d - a)).sum(1) / 6


def triangles(grid: TetrahedralGrid) -> Counter[tuple[int, ...]]:
    """How many tetrahedra have each triangle."""
    return Counter(corners for one in grid.tetrahedra.tolist() for corners in combinations(sorted(one), 3))


@given(sides, sides, sides, st.integers(1, 6))
def test_positive_tetrahedra_fill_a_box_of_cubes_around_the_box_asked_for(
    x: float, y: float, z: float, resolution: int
) -> None:
    low = torch.tensor([-1.0, 0.3, 2.0], dtype=torch.float64)
    high = low + torch.tensor([x, y, z], dtype=torch.float64)
    grid = TetrahedralGrid.of(low, high, resolution)
    first, last = grid.vertices.amin(0), grid.vertices.amax(0)
    assert grid.spacing == pytest.approx(max(x, y, z) / resolution)
    assert (first <= low + 2e-4 * grid.spacing).all()
    assert (last >= high - 2e-4 * grid.spacing).all()
    assert (last - first < high - low + grid.spacing).all()
    torch.testing.assert_close(first + last, low + high)
    assert (volumes(grid) > 0).all()
    assert float(volumes(grid).sum()) == pytest.approx(float((last - first).prod()))


def test_neighbours_share_whole_faces() -> None:
    low = torch.tensor([-1.0, -0.7, 0.0], dtype=torch.float64)
    grid = TetrahedralGrid.of(low, low + torch.tensor([0.5, 0.9, 1.1]), 4)
    counts = triangles(grid)
    assert set(counts.values()) == {1, 2}
    first, last = grid.vertices.amin(0), grid.vertices.amax(0)
    outer = grid.vertices[torch.tensor([corners for corners, count in counts.items() if count == 1])]
    on_a_side = ((outer - first).abs() < 1e-9).all(1) | ((outer - last).abs() < 1e-9).all(1)
    assert on_a_side.any(1).all()


def test_a_grid_is_a_solid_without_holes() -> None:
    grid = cube(1.0, 3)
    edges = {pair for one in grid.tetrahedra.tolist() for pair in combinations(sorted(one), 2)}
    assert len(grid.vertices) - len(edges) + len(triangles(grid)) - len(grid.tetrahedra) == 1
    assert set(grid.tetrahedra.flatten().tolist()) == set(range(len(grid.vertices)))


def test_inner_tetrahedra_are_of_one_shape() -> None:
    grid = cube(1.0, 4)
    corners = grid.vertices[grid.tetrahedra]
    inner = (corners.abs().amax((1, 2)) < 1 - 1e-9).nonzero().squeeze(1)
    lengths = torch.stack([(corners[:, i] - corners[:, j]).norm(dim=1) for i, j in combinations(range(4), 2)], dim=1)
    expected = torch.tensor([3**0.5 / 2] * 4 + [1.0] * 2, dtype=torch.float64)
    torch.testing.assert_close(lengths[inner].sort(dim=1).values / grid.spacing, expected.expand(len(inner), 6))


def test_vertices_are_of_the_boxs_type() -> None:
    assert cube(1.0, 2, torch.float32).vertices.dtype == torch.float32
    assert cube(1.0, 2, torch.float64).vertices.dtype == torch.float64


@pytest.mark.parametrize(
    "high", [[1.0, 0.0, 1.0], [1.0, -1.0, 1.0], [1.0, float("nan"), 1.0], [1.0, float("inf"), 1.0]]
)
def test_a_box_needs_three_sides(high: list[float]) -> None:
    with pytest.raises(DynhairError, match="no box"):
        TetrahedralGrid.of(torch.zeros(3), torch.tensor(high), 4)


def test_a_resolution_is_positive() -> None:
    with pytest.raises(DynhairError, match="resolution of 0"):
        TetrahedralGrid.of(torch.zeros(3), torch.ones(3), 0)
