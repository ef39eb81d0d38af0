"""A head that follows where it is dragged, as smoothly as a neck would."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from dynhair.capture import ExpressionBasis, HeadTrack

STIFFNESS = 14.0
"""1/s; the critically damped head has gone four fifths of a step after 3 / 14 = 0.21 s."""

_STILL = 1e-4  # metres and radians: a lag that nobody sees


class LiveHead:
    """Follows a target at a fixed frame rate, however seldom the target is given or the head is looked at.

    A pointer jumps from event to event, at any rate; its differences would be noise to a network that was trained on
    the motion of heads. So the head is a critically damped spring: its position and velocity are continuous.

    Args:
        rotation: where it begins: of the head frame in the world.
        translation: of the head frame's origin, metres.
        fps: frames per second.
        history: how many frames before the last the hair depends on.
        now: when it begins, seconds on a monotonic clock.
    """

    def __init__(
        self,
        rotation: Float64[np.ndarray, "3 3"],
        translation: Float64[np.ndarray, " 3"],
        *,
        fps: float,
        history: int,
        now: float,
    ) -> None:
        self.fps, self._start, self._frame, self._steps = fps, now, 0, 0
        self._target = Rotation.from_matrix(rotation), np.array(translation)
        self._lag, self._velocity = np.zeros(6), np.zeros(6)
        # three frames more than the hair sees: a second difference reaches two back, and one is at rest
        self._past: deque[tuple[np.ndarray, np.ndarray]] = deque(
            [(np.array(rotation), np.array(translation))] * (history + 4), history + 4
        )
        self._still = history + 4

    @property
    def steps(self) -> int:
        """Frames in which it moved; two moments of the same number look the same."""
        return self._steps

    @property
    def moving(self) -> bool:
        """Whether the head, or hair that follows it, will look different in a frame to come."""
        return self._still < len(self._past)

    @property
    def pose(self) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]]:
        """Rotation and translation in the last frame."""
        return self._past[-1]

    def aim(self, rotation: Float64[np.ndarray, "3 3"], translation: Float64[np.ndarray, " 3"], now: float) -> None:
        """Go to a pose from where the head is."""
        self.advance(now)
        turned, place = self._target
        self._target = Rotation.from_matrix(rotation), np.array(translation)
        # where it is stays where it is: only what it lags behind is another
        current = Rotation.from_rotvec(self._lag[:3]) * turned, self._lag[3:] + place
        self._lag = np.r_[(current[0] * self._target[0].inv()).as_rotvec(), current[1] - self._target[1]]
        self._still = 0

    def advance(self, now: float) -> None:
        """Go on to the last frame before ``now``; after a long pause, only the frames that matter are made."""
        frame = math.floor((now - self._start) * self.fps + 1e-6)
        missed = frame - self._frame
        self._frame = max(frame, self._frame)
        for _ in range(min(missed, len(self._past))):
            if self.moving:
                self._step(1 / self.fps)

    def wait(self, now: float) -> float | None:
        """Seconds until the next frame; None where it would show nothing new."""
        return max((self._frame + 1) / self.fps + self._start - now, 0.0) if self.moving else None

    def track(
        self,
        expression: Float64[np.ndarray, " e"],
        gravity: Float64[np.ndarray, " 3"],
        basis: ExpressionBasis | None = None,
    ) -> HeadTrack:
        """The recent motion; its last frame is now."""
        rotations, translations = (np.stack(parts) for parts in zip(*self._past, strict=True))
        expressions = np.repeat(expression[None].astype(np.float32), len(rotations), 0)
        return HeadTrack(rotations, translations, expressions, self.fps, gravity, basis)

    def _step(self, seconds: float) -> None:
        self._steps += 1
        # the exact solution of x'' = -k^2 x - 2 k x'
        change = self._velocity + STIFFNESS * self._lag
        fading = math.exp(-STIFFNESS * seconds)
        self._lag = (self._lag + change * seconds) * fading
        self._velocity = (self._velocity - STIFFNESS * change * seconds) * fading
        if max(np.abs(self._lag).max(), np.abs(self._velocity).max() / STIFFNESS) < _STILL:
            self._lag, self._velocity = np.zeros(6), np.zeros(6)
            self._still += 1
        turned, place = self._target
        self._past.append(((Rotation.from_rotvec(self._lag[:3]) * turned).as_matrix(), self._lag[3:] + place))
