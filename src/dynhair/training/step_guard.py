"""Which steps are skipped, so that one bad step does not spoil a training, and when there have been too many."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping
from typing import Any

EXPLOSION = 100.0
"""A gradient so many times the usual one is skipped.

Adam bounds what one such step does to the parameters, and not what it does to its own second moments: they would grow
by a factor of ``1 + 0.001 EXPLOSION^2`` = 11, and make the next thousand steps 3.3 times as short. In 700 steps on the
bundled capture, static views among them, no gradient was more than 3.9 times the usual one.
"""

HISTORY = 100
"""The usual gradient is the median of so many last ones, ..."""

ENOUGH = 20
"""... once there are so many."""

IN_A_ROW = 10
"""Training stops after so many skipped steps in a row: each saw other images, so the images are not at fault."""


class StepGuard:
    """Judges steps by their loss and gradient, and counts those that were skipped.

    Args:
        limit: steps that may be skipped in a training, and in a row if it is less than `IN_A_ROW`.

    Attributes:
        skipped: steps skipped in all.
        in_a_row: the last steps without a good one.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.skipped = self.in_a_row = 0
        self._norms: deque[float] = deque(maxlen=HISTORY)

    @property
    def usual(self) -> float | None:
        """The usual norm of the gradient; None if too few are known."""
        return statistics.median(self._norms) if len(self._norms) >= ENOUGH else None

    @property
    def exhausted(self) -> bool:
        """Whether too many steps were skipped."""
        return self.skipped > self.limit or self.in_a_row > min(self.limit, IN_A_ROW)

    def judge(self, loss: float, norm: float) -> str | None:
        """Count a step.

        Args:
            loss: the step's loss.
            norm: Euclidean norm of its whole gradient.

        Returns:
            Why the step must be skipped; None if it may be taken.
        """
        fault = self._fault(loss, norm)
        if fault is None:
            self._norms.append(norm)
            self.in_a_row = 0
        else:
            self.skipped += 1
            self.in_a_row += 1
        return fault

    def _fault(self, loss: float, norm: float) -> str | None:
        if not math.isfinite(loss):
            return "the loss is not finite"
        if not math.isfinite(norm):
            return "the gradient is not finite"
        usual = self.usual
        if usual and norm > EXPLOSION * usual:
            return f"the gradient's norm is {norm:.3g}, usually {usual:.3g}"
        return None

    def state(self) -> dict[str, Any]:
        """Everything that it remembers, as JSON values."""
        return {"skipped": self.skipped, "in_a_row": self.in_a_row, "norms": list(self._norms)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Remember what an earlier guard did."""
        self.skipped, self.in_a_row = int(state["skipped"]), int(state["in_a_row"])
        self._norms = deque((float(norm) for norm in state["norms"]), maxlen=HISTORY)
