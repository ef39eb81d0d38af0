"""What the landmark detector saw of one take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from dynhair.errors import DynhairError


@dataclass(frozen=True)
class Observations:
    """Landmarks of all views of one take: consecutive frames of calibrated, synchronised cameras.

    Attributes:
        points: landmarks in pixels; anything where the score is 0.
        scores: how far each landmark can be trusted, in [0, 1]; 0 where it is missing.
        w2c: world-to-camera ``[R | t]``, metres.
        K: intrinsics in pixels.
        expression_hints: strength of each facial action as the detector guesses it; None if it does not.
        fps: frames per second.
        name: what messages call the take.
    """

    points: Float[ndarray, "f v n 2"]
    scores: Float[ndarray, "f v n"]
    w2c: Float[ndarray, "f v 3 4"]
    K: Float[ndarray, "f v 3 3"]
    expression_hints: Float[ndarray, "f e"] | None
    fps: float
    name: str = "take"

    def __post_init__(self) -> None:
        frames, views, count = self.scores.shape
        if (
            self.points.shape != (frames, views, count, 2)
            or self.w2c.shape != (frames, views, 3, 4)
            or self.K.shape != (frames, views, 3, 3)
            or (self.expression_hints is not None and len(self.expression_hints) != frames)
        ):
            raise DynhairError(
                f"{self.name}: landmarks, scores and cameras are of different numbers of frames, views or points",
                expected="points (f, v, n, 2), scores (f, v, n), w2c (f, v, 3, 4), K (f, v, 3, 3), hints (f, e)",
            )
        if not self.fps > 0:
            raise DynhairError(f"{self.name}: a frame rate of {self.fps}", expected="a positive frame rate")
        if not np.isfinite(self.points[self.scores > 0]).all():
            raise DynhairError(
                f"{self.name}: landmarks are not finite", expected="a score of 0 where a landmark is missing"
            )

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return len(self.points)
