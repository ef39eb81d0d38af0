"""Farthest-point sampling."""

from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.strands.spreading import farthest_points


@given(st.integers(1, 30), st.integers(0, 40), st.integers(0, 5))
def test_each_point_is_the_farthest_from_those_before(count: int, wanted: int, seed: int) -> None:
    points = torch.randn(count, 3, generator=torch.Generator().manual_seed(seed))
    chosen = farthest_points(points, wanted).tolist()
    assert len(chosen) == len(set(chosen)) == min(wanted, count)
    gaps = torch.cdist(points.double(), points.double())
    for index in range(1, len(chosen)):
        nearest = gaps[:, chosen[:index]].amin(1)
        assert nearest[chosen[index]] == nearest.max()


@given(st.integers(0, 20), st.integers(0, 20))
def test_fewer_points_are_the_beginning_of_more(few: int, more: int) -> None:
    points = torch.randn(20, 3, generator=torch.Generator().manual_seed(0))
    few, more = min(few, more), max(few, more)
    assert farthest_points(points, few).tolist() == farthest_points(points, more).tolist()[:few]


def test_points_in_one_place_are_each_taken_once() -> None:
    assert sorted(farthest_points(torch.zeros(5, 3), 5).tolist()) == [0, 1, 2, 3, 4]
    assert farthest_points(torch.zeros(0, 3), 5).tolist() == []
