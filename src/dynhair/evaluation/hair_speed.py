"""Non-rigid velocity and acceleration of hair as a cloud of points (paper, "Quantitative evaluation").

Of the clouds P^t in the head's frame, whose points need not be the same hair in two frames,

    s_t          = fps mean over p in P^t of min over q in P^(t+1) of |q - p|
    velocity     = mean_t s_t                                   m/s
    acceleration = fps mean_t |s_(t+1) - s_t|                   m/s^2

The paper gives both in the unit of its scenes for the time between two frames: divide the velocity by the frame rate,
and the acceleration by its square. A nearest neighbour is never further than the same point, so fast hair seems
slower, and more so the more points there are: figures compare only at equal counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree
from torch import Tensor

from dynhair.errors import DynhairError


class HairSpeedFigures(NamedTuple):
    """Means over pairs of frames; ``nan`` where there are none.

    Attributes:
        velocity: m/s.
        acceleration: m/s^2.
    """

    velocity: float
    acceleration: float


class HairSpeed:
    """Adds up consecutive frames of a motion, remembering the last.

    Args:
        fps: frames per second.
    """

    def __init__(self, fps: float) -> None:
        if not fps > 0:
            raise DynhairError(f"the frame rate is {fps}", expected="a positive number")
        self._fps = fps
        self._last: Float[np.ndarray, "p 3"] | None = None
        self._last_speed: float | None = None
        self._speeds = np.zeros(2)
        self._changes = np.zeros(2)

    def add(self, points: Float[Tensor, "p 3"]) -> None:
        """Add the next frame.

        Args:
            points: in the head's frame, metres, at least one.
        """
        if not len(points):
            raise DynhairError("a cloud of hair has no points", expected="at least one")
        now = points.detach().cpu().double().numpy()
        last, self._last = self._last, now
        if last is None:
            return
        distances, _ = KDTree(now).query(last)
        speed = float(np.mean(distances)) * self._fps
        self._speeds += (speed, 1)
        if self._last_speed is not None:
            self._changes += (abs(speed - self._last_speed) * self._fps, 1)
        self._last_speed = speed

    def merge(self, other: HairSpeed) -> None:
        """Add another motion."""
        self._speeds += other._speeds
        self._changes += other._changes

    def figures(self) -> HairSpeedFigures:
        """Take the means of all that was added."""
        with np.errstate(invalid="ignore"):
            return HairSpeedFigures(*(float(sum_ / count) for sum_, count in (self._speeds, self._changes)))
