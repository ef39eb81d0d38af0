"""A low-pass filter without lag for evenly sampled motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation

from dynhair.animation.reflection import reflected_rotations, reflected_vectors

_SETTLING = 3.0
"""Periods of the cut-off frequency after which the filter has forgotten its start."""


@dataclass(frozen=True)
class LowPass:
    """A Butterworth filter run forwards and backwards: its two lags cancel.

    At a frequency f the amplitude is multiplied by ``1 / (1 + (f / cutoff)^(2 order))``, half at the cut-off.

    Attributes:
        rate: samples per second.
        cutoff: Hz, below half of ``rate``.
        order: of the filter; how sharply it cuts.
    """

    rate: float
    cutoff: float
    order: int

    def rotations(self, rotations: Float64[np.ndarray, "f 3 3"]) -> Float64[np.ndarray, "f 3 3"]:
        """Filter rotations: each becomes the weighted chordal mean of its neighbours.

        The unit quaternions are filtered and normalised. That is exact for a rotation at constant velocity about one
        axis, which keeps its phase; and the result does not depend on the world's axes.
        """
        count = self._margin(len(rotations))
        quaternions = Rotation.from_matrix(reflected_rotations(rotations, count)).as_quat()
        turns_over = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0
        signs = np.where(np.cumsum(np.r_[False, turns_over]) % 2, -1.0, 1.0)
        filtered = self._filtered(quaternions * signs[:, None])[count : count + len(rotations)]
        return Rotation.from_quat(filtered).as_matrix()

    def vectors(self, values: Float64[np.ndarray, "f d"]) -> Float64[np.ndarray, "f d"]:
        """Filter each column."""
        count = self._margin(len(values))
        return self._filtered(reflected_vectors(values, count))[count : count + len(values)]

    def _margin(self, length: int) -> int:
        return min(length - 1, math.ceil(_SETTLING * self.rate / self.cutoff))

    def _filtered(self, values: Float64[np.ndarray, "n d"]) -> Float64[np.ndarray, "n d"]:
        sections = butter(self.order, self.cutoff, fs=self.rate, output="sos")
        # a copy, for what is filtered backwards lies backwards in memory, which torch does not take
        return np.ascontiguousarray(sosfiltfilt(sections, values, axis=0, padlen=0))
