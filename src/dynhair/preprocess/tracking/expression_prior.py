"""What expressions are likely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_BOUND_SOFTNESS = 0.05


@dataclass(frozen=True)
class ExpressionPrior:
    """Facial actions are near what the detector guesses, and hardly outside of their natural range.

    Attributes:
        mean: of each facial action in each frame.
        deviation: standard deviation about the mean.
        bounds: natural range; outside of it a coefficient pays for its distance in units of a twentieth of the range.
    """

    mean: Float[ndarray, "f e"]
    deviation: float
    bounds: tuple[float, float]

    @property
    def _softness(self) -> float:
        return _BOUND_SOFTNESS * (self.bounds[1] - self.bounds[0])

    def cost(self, expressions: Float[ndarray, "f e"]) -> float:
        """Negative log-likelihood."""
        about_mean = ((expressions - self.mean) ** 2).sum() / self.deviation**2
        return float(about_mean + (self._excess(expressions) ** 2).sum() / self._softness**2) / 2

    def linearised(self, expressions: Float[ndarray, "f e"]) -> tuple[Float[ndarray, "f e"], Float[ndarray, "f e"]]:
        """Gradient and diagonal of the curvature."""
        excess = self._excess(expressions)
        gradient = (expressions - self.mean) / self.deviation**2 + excess / self._softness**2
        return gradient, 1 / self.deviation**2 + (excess != 0) / self._softness**2

    def at(self, frames: ndarray | slice) -> ExpressionPrior:
        """Some of the frames."""
        return ExpressionPrior(self.mean[frames], self.deviation, self.bounds)

    @classmethod
    def joined(cls, parts: Sequence[ExpressionPrior]) -> ExpressionPrior:
        """Frames of several in a row, which must have the same deviation and bounds."""
        return replace(parts[0], mean=np.concatenate([part.mean for part in parts]))

    def _excess(self, expressions: Float[ndarray, "f e"]) -> Float[ndarray, "f e"]:
        return expressions - np.clip(expressions, *self.bounds)
