"""How learning rates fall."""

from __future__ import annotations

import math

LAST_RATE = 0.05


def falling_rate(step: int, iterations: int, last: float = LAST_RATE) -> float:
    """The factor on learning rates: a cosine from 1 to ``last`` (the paper gives no schedule).

    Args:
        step: steps done.
        iterations: steps of the whole stage.
        last: the factor at the end.
    """
    return last + (1 - last) * 0.5 * (1 + math.cos(math.pi * step / iterations))
