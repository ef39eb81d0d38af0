"""Which steps are skipped."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.training.step_guard import ENOUGH, EXPLOSION, IN_A_ROW, StepGuard

norms = st.floats(1e-3, 1e3)


def judged(guard: StepGuard, count: int, norm: float = 1.0) -> StepGuard:
    for _ in range(count):
        assert guard.judge(0.5, norm) is None
    return guard


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_skipped(wrong: float) -> None:
    guard = StepGuard(10)
    assert "loss" in (guard.judge(wrong, 1.0) or "")
    assert "gradient" in (guard.judge(0.5, abs(wrong)) or "")
    assert guard.skipped == guard.in_a_row == 2


def test_an_exploding_gradient_is_skipped_once_the_usual_one_is_known() -> None:
    guard = judged(StepGuard(10), ENOUGH - 1)
    assert guard.judge(0.5, 2 * EXPLOSION) is None
    assert guard.judge(0.5, 2 * EXPLOSION) is not None
    assert guard.judge(0.5, EXPLOSION / 2) is None
    assert (guard.skipped, guard.in_a_row) == (1, 0)


@given(st.lists(norms, min_size=ENOUGH, max_size=300))
def test_gradients_within_a_hundredfold_are_never_skipped(values: list[float]) -> None:
    spread = [1 + value / 1e3 * (EXPLOSION - 2) for value in values]
    guard = StepGuard(0)
    assert all(guard.judge(1.0, norm) is None for norm in spread)
    assert not guard.exhausted


def test_after_gradients_of_nought_any_gradient_is_taken() -> None:
    assert judged(StepGuard(0), ENOUGH, norm=0.0).judge(0.5, 1.0) is None


def test_a_skipped_gradient_does_not_become_the_usual_one() -> None:
    guard = judged(StepGuard(1000), 30)
    for _ in range(200):
        assert guard.judge(0.5, 1e4) is not None
    assert guard.usual == 1.0


def test_skipped_steps_are_limited_in_all_and_in_a_row() -> None:
    guard = StepGuard(100)
    for _ in range(100):
        guard.judge(math.nan, 1.0)
        judged(guard, 1)
        assert not guard.exhausted
    guard.judge(math.nan, 1.0)
    assert guard.exhausted
    other = StepGuard(100)
    for _ in range(IN_A_ROW):
        other.judge(math.nan, 1.0)
        assert not other.exhausted
    other.judge(math.nan, 1.0)
    assert other.exhausted
    none = StepGuard(0)
    none.judge(math.nan, 1.0)
    assert none.exhausted


@given(st.lists(st.one_of(norms, st.just(math.nan), st.just(1e9)), max_size=250), st.integers(0, 250))
def test_a_restored_guard_judges_like_one_that_went_on(values: list[float], cut: int) -> None:
    whole, first, second = StepGuard(5), StepGuard(5), StepGuard(5)
    expected = [whole.judge(1.0, norm) for norm in values]
    found = [first.judge(1.0, norm) for norm in values[:cut]]
    second.restore(json.loads(json.dumps(first.state())))
    found += [second.judge(1.0, norm) for norm in values[cut:]]
    assert found == expected
    assert second.state() == whole.state()
