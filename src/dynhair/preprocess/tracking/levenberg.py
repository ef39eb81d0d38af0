"""Levenberg and Marquardt's damped Gauss-Newton iterations."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

State = TypeVar("State")

_ENOUGH = 1e-7
_HIGHEST_DAMPING = 1e6


def minimise(
    state: State,
    cost: Callable[[State], float],
    linearise: Callable[[State], Callable[[float], State]],
    iterations: int,
) -> State:
    """Lower a cost until it hardly changes.

    Args:
        state: where to start.
        cost: what to lower.
        linearise: makes the step function at a state: from a damping, a factor on the curvature's diagonal, to the next
            state.
        iterations: the most steps to accept.

    Returns:
        The state of least cost.
    """
    best, damping = cost(state), 1e-4
    for _ in range(iterations):
        step = linearise(state)
        while True:
            candidate = step(damping)
            found = cost(candidate)
            if found < best or damping > _HIGHEST_DAMPING:
                break
            damping *= 10
        if not found < best:
            return state
        gain, state, best = best - found, candidate, found
        damping = max(damping / 10, 1e-8)
        if gain < _ENOUGH * (1 + abs(best)):
            return state
    return state
