"""Regions against SciPy's triangulation, distance transform and morphology."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter
from scipy.spatial import Delaunay

from dynhair.evaluation.regions import BAND, boundary_band, convex_region, dilated


def pixel_centres(width: int, height: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)


def blobs(seed: int, size: tuple[int, int] = (90, 70)) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, 1.0, (2, *size))
    return gaussian_filter(noise, (0, 5, 5)) > 0.02


@given(st.integers(0, 1000), st.integers(3, 20))
def test_a_hull_holds_the_pixels_that_its_triangulation_holds(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).uniform(-10.0, 50.0, (count, 2))
    expected = Delaunay(points).find_simplex(pixel_centres(40, 30)) >= 0
    np.testing.assert_array_equal(convex_region(points, 40, 30), expected)


def test_a_hull_counts_pixels_by_their_centre() -> None:
    region = convex_region(np.array([[2.4, 1.4], [5.6, 1.4], [5.6, 3.4], [2.4, 3.4]]), 8, 6)
    assert {(int(row), int(column)) for row, column in np.argwhere(region)} == {
        (row, column) for row in (1, 2) for column in (2, 3, 4, 5)
    }


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 2)),
        np.array([[3.0, 3.0], [9.0, 5.0]]),
        np.array([[1.0, 1.0], [5.0, 5.0], [9.0, 9.0]]),
        np.full((5, 2), 4.0),
        np.array([[1.0, 1.0], [np.nan, 5.0], [9.0, 2.0]]),
        np.array([[100.0, 100.0], [120.0, 100.0], [110.0, 130.0]]),
    ],
    ids=["none", "two", "a line", "one place", "not finite", "outside"],
)
def test_points_without_a_hull_in_the_image_select_nothing(points: np.ndarray) -> None:
    assert not convex_region(points, 20, 16).any()


def test_the_band_is_what_lies_near_the_edge_on_both_sides() -> None:
    silhouettes = blobs(0)
    reach = BAND * 90 + 0.5
    inside, outside = (
        np.stack([np.asarray(distance_transform_edt(s)) for s in side]) for side in (silhouettes, ~silhouettes)
    )
    expected = inside + outside <= reach
    np.testing.assert_array_equal(boundary_band(torch.from_numpy(silhouettes)).numpy(), expected)


def test_the_band_is_three_pixels_on_each_side_at_256() -> None:
    silhouette = torch.zeros(1, 256, 256, dtype=torch.bool)
    silhouette[:, :, 100:] = True
    columns = boundary_band(silhouette)[0].all(dim=0)
    assert columns.nonzero().ravel().tolist() == [97, 98, 99, 100, 101, 102]


@given(st.integers(0, 1000))
def test_inside_and_outside_have_the_same_band(seed: int) -> None:
    silhouettes = torch.from_numpy(blobs(seed))
    assert torch.equal(boundary_band(silhouettes), boundary_band(~silhouettes))


def test_images_without_an_edge_have_no_band() -> None:
    assert not boundary_band(torch.stack([torch.zeros(20, 20), torch.ones(20, 20)]).bool()).any()


@pytest.mark.parametrize("radius", [0, 1, 4])
def test_dilation_is_by_a_disk(radius: int) -> None:
    region = np.random.default_rng(3).random((2, 40, 30)) < 0.02
    offset = np.arange(-radius, radius + 1)
    disk = offset**2 + offset[:, None] ** 2 <= radius**2
    expected = np.stack([binary_dilation(view, disk) for view in region])
    np.testing.assert_array_equal(dilated(torch.from_numpy(region), radius).numpy(), expected)
