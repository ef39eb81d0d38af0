from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.viewer.resolution import BUDGET, HEIGHTS, Resolution


def settled(seconds_of: dict[str, float], pictures: int = 60) -> list[int]:
    """Heights of pictures whose cost is constant plus proportional to the pixels."""
    resolution, heights = Resolution(), []
    for _ in range(pictures):
        heights.append(resolution.moving(10_000))
        resolution.took(seconds_of["fixed"] + seconds_of["each"] * (heights[-1] / 512) ** 2)
    return heights


@given(fixed=st.floats(0, 0.2), each=st.floats(0, 0.5))
def test_the_size_settles(fixed: float, each: float) -> None:
    heights = settled({"fixed": fixed, "each": each})
    assert len(set(heights[-20:])) == 1
    assert set(heights) <= set(HEIGHTS)


@given(fixed=st.floats(0, 0.05), each=st.floats(0.001, 0.5))
def test_the_settled_size_keeps_to_the_budget_where_any_does(fixed: float, each: float) -> None:
    height = settled({"fixed": fixed, "each": each})[-1]
    assert fixed + each * (height / 512) ** 2 <= 1.25 * BUDGET or height == HEIGHTS[0]


def test_a_quick_machine_gets_the_largest_pictures() -> None:
    assert settled({"fixed": 0.001, "each": 0.001})[-1] == HEIGHTS[-1]


def test_a_single_slow_picture_changes_nothing_once_many_were_quick() -> None:
    resolution = Resolution(512)
    for _ in range(10):
        resolution.took(BUDGET * 0.9)
    resolution.took(BUDGET * 1.5)
    assert resolution.height == 512


@pytest.mark.parametrize(("canvas", "moving", "still"), [(200, 200, 200), (700, 384, 700), (3000, 384, 1080)])
def test_no_picture_is_larger_than_the_page(canvas: int, moving: int, still: int) -> None:
    assert Resolution().moving(canvas) == moving
    assert Resolution().still(canvas) == still
