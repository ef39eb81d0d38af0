"""Quantiles of a stream of any length, in constant memory and with a bound on the error (Masson et al. 2019, DDSketch).

Bin i > 0 counts the values in (s g^(i-1), s g^i], with s the smallest value told from zero. Any value of the bin is
within the relative error a = (g - 1) / (g + 1) of its answer, 2 s g^i / (g + 1).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from dynhair.errors import DynhairError

RELATIVE_ERROR = 1e-3
SMALLEST = 1e-6
"""Values up to this count as zero."""

LARGEST = 1e6
"""Values beyond this count as this."""

_GROWTH = (1 + RELATIVE_ERROR) / (1 - RELATIVE_ERROR)
_BINS = 1 + math.ceil(math.log(LARGEST / SMALLEST) / math.log(_GROWTH))


class QuantileSketch:
    """Counts values that are zero or more; 110 kB, however many there are.

    Attributes:
        count: of the values so far.
    """

    def __init__(self) -> None:
        self.count = 0
        self._counts = np.zeros(_BINS, np.int64)

    def add(self, values: Float[np.ndarray, " n"]) -> None:
        """Count values.

        Raises:
            DynhairError: one is negative or not finite.
        """
        if not (np.isfinite(values) & (values >= 0)).all():
            raise DynhairError("a sketch of quantiles was given a bad value", expected="finite values of 0 or more")
        clamped = np.clip(values.astype(np.float64), SMALLEST, LARGEST)
        bins = np.ceil(np.log(clamped / SMALLEST) / math.log(_GROWTH)).astype(np.int64).clip(0, _BINS - 1)
        self._counts += np.bincount(bins, minlength=_BINS)
        self.count += len(values)

    def merge(self, other: QuantileSketch) -> None:
        """Count all that ``other`` has counted."""
        self._counts += other._counts
        self.count += other.count

    def quantile(self, share: float) -> float:
        """Find the least value that at least a share of all values do not exceed.

        Args:
            share: in [0, 1]; 0.5 for the median.

        Returns:
            That value, within `RELATIVE_ERROR`, or within `SMALLEST` where it is no larger than that; ``nan`` of no
            values.

        Raises:
            DynhairError: ``share`` is not in [0, 1].
        """
        if not 0 <= share <= 1:
            raise DynhairError(f"{share} is no share of values", expected="a number in [0, 1]")
        if not self.count:
            return math.nan
        rank = max(1, math.ceil(share * self.count))
        bin_ = int(np.searchsorted(self._counts.cumsum(), rank))
        return 2 * SMALLEST * _GROWTH**bin_ / (_GROWTH + 1) if bin_ else 0.0
