"""The sketch of quantiles against exact ones, within its own bound."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.evaluation.quantiles import LARGEST, RELATIVE_ERROR, SMALLEST, QuantileSketch

values_ = st.lists(st.floats(0.0, LARGEST), min_size=1, max_size=40)
ROUNDING = 1 + 1e-12


def sketch(*batches: list[float]) -> QuantileSketch:
    made = QuantileSketch()
    for batch in batches:
        made.add(np.array(batch, np.float64))
    return made


@given(values_, st.floats(0.0, 1.0))
def test_is_within_its_bound_of_the_exact_quantile(values: list[float], share: float) -> None:
    exact = float(np.quantile(values, share, method="inverted_cdf"))
    found = sketch(values).quantile(share)
    assert abs(found - exact) <= max(RELATIVE_ERROR * exact * ROUNDING, SMALLEST)


@given(values_, values_)
def test_parts_and_order_do_not_matter(first: list[float], second: list[float]) -> None:
    whole = sketch(first + second)
    merged = sketch(second[::-1])
    merged.merge(sketch(first))
    assert merged.count == whole.count == len(first) + len(second)
    for other in (merged, sketch(first, second)):
        assert [other.quantile(share) for share in (0.0, 0.1, 0.5, 1.0)] == [
            whole.quantile(share) for share in (0.0, 0.1, 0.5, 1.0)
        ]


def test_a_million_values() -> None:
    values = np.random.default_rng(0).lognormal(-2.0, 3.0, 1_000_000)
    made = QuantileSketch()
    for part in np.split(values, 10):
        made.add(part)
    for share in (0.01, 0.5, 0.95):
        assert made.quantile(share) == pytest.approx(np.quantile(values, share), rel=1.1 * RELATIVE_ERROR)


def test_out_of_reach_counts_as_the_nearest_in_reach() -> None:
    assert sketch([0.0, SMALLEST / 2]).quantile(1.0) == 0.0
    assert sketch([1e30]).quantile(0.5) == pytest.approx(LARGEST, rel=2 * RELATIVE_ERROR)
    assert math.isnan(sketch().quantile(0.5))


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_bad_values(bad: float) -> None:
    with pytest.raises(DynhairError, match="bad value"):
        sketch([1.0, bad])


@pytest.mark.parametrize("share", [-0.1, 1.1, math.nan])
def test_bad_shares(share: float) -> None:
    with pytest.raises(DynhairError, match="no share"):
        sketch([1.0]).quantile(share)
