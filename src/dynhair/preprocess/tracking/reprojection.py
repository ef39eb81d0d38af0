"""How well points of the head agree with the landmarks in all views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_FREEDOM = 3.0  # of Student's t: a landmark six deviations off pulls with a thirteenth of its normal weight
_NEAREST = 0.01  # metres before the camera
_EXPECTED_COUNT = 50.0

PointTerm = tuple[Float[ndarray, "f n 3"], Float[ndarray, "f n 3 3"]]
"""Gradient and Gauss-Newton curvature of a cost with respect to world points."""


def project(
    points: Float[ndarray, "f n 3"], w2c: Float[ndarray, "f v 3 4"], K: Float[ndarray, "f v 3 3"]
) -> tuple[Float[ndarray, "f v n 2"], Float[ndarray, "f v n 2 3"]]:
    """World points to pixels in each view, and how pixels change with world points."""
    turn, shift = w2c[..., :3], w2c[..., 3]
    local = points[:, None] @ turn.swapaxes(-1, -2) + shift[..., None, :]
    depth = np.maximum(local[..., 2:], _NEAREST)
    pixels = (local / depth) @ K[..., :2, :].swapaxes(-1, -2)
    slopes = (K[:, :, None, :2] - pixels[..., None] * [0.0, 0.0, 1.0]) / depth[..., None]
    return pixels, slopes @ turn[:, :, None]


@dataclass(frozen=True)
class Reprojection:
    """Landmarks of all views as a cost of where the points of the head are: robust and weighted reprojection errors.

    Errors follow Student's t with 3 degrees of freedom, so that landmarks far off hardly pull.

    Attributes:
        landmarks: in pixels; anything where ``scores`` is 0.
        scores: factors on each landmark's cost.
        deviations: expected error of each landmark, pixels.
        w2c: world-to-camera, metres.
        K: intrinsics in pixels.
    """

    landmarks: Float[ndarray, "f v n 2"]
    scores: Float[ndarray, "f v n"]
    deviations: Float[ndarray, "f v n"]
    w2c: Float[ndarray, "f v 3 4"]
    K: Float[ndarray, "f v 3 3"]

    def residuals(self, points: Float[ndarray, "f n 3"]) -> Float[ndarray, "f v n 2"]:
        """Landmark less projection, pixels; 0 where the landmark is missing."""
        found = project(points, self.w2c, self.K)[0]
        return np.where((self.scores > 0)[..., None], self.landmarks - found, 0.0)

    def squared_errors(self, points: Float[ndarray, "f n 3"]) -> Float[ndarray, "f v n"]:
        """Squared residuals in units of the expected error."""
        return (self.residuals(points) ** 2).sum(-1) / self.deviations**2

    def cost(self, points: Float[ndarray, "f n 3"]) -> float:
        """Negative log-likelihood."""
        return float((self.scores * (_FREEDOM + 2) / 2 * np.log1p(self.squared_errors(points) / _FREEDOM)).sum())

    def linearised(self, points: Float[ndarray, "f n 3"]) -> PointTerm:
        """Gradient and Gauss-Newton curvature of the cost with iteratively reweighted errors."""
        pixels, slopes = project(points, self.w2c, self.K)
        residuals = np.where((self.scores > 0)[..., None], self.landmarks - pixels, 0.0)
        weights = self.scores * _robust_weights((residuals**2).sum(-1) / self.deviations**2) / self.deviations**2
        count = residuals.shape[2]
        # Rows of all views of a point together: matrix products are several times faster than sums over views.
        rows = slopes.transpose(0, 2, 1, 3, 4).reshape(len(slopes), count, -1, 3)
        weighted = rows.swapaxes(-1, -2) * np.repeat(weights.transpose(0, 2, 1), 2, axis=-1)[..., None, :]
        errors = residuals.transpose(0, 2, 1, 3).reshape(len(slopes), count, -1, 1)
        return -(weighted @ errors)[..., 0], weighted @ rows

    def at(self, frames: ndarray | slice) -> Reprojection:
        """Some of the frames."""
        return Reprojection(*(getattr(self, field)[frames] for field in self.__dataclass_fields__))

    @classmethod
    def joined(cls, parts: Sequence[Reprojection]) -> Reprojection:
        """Frames of several in a row; where one has fewer views than another, its last views see nothing."""
        views = max(part.scores.shape[1] for part in parts)

        def padded(array: ndarray) -> ndarray:
            missing = ((0, 0), (0, views - array.shape[1]), *((0, 0) for _ in array.shape[2:]))
            return np.pad(array, missing, mode="edge")

        whole = cls(*(np.concatenate([padded(getattr(p, f)) for p in parts]) for f in cls.__dataclass_fields__))
        for part, scores in zip(parts, np.split(whole.scores, np.cumsum([len(p.scores) for p in parts])), strict=False):
            scores[:, part.scores.shape[1] :] = 0
        return whole

    def blurred(self, factors: float | Float[ndarray, " n"]) -> Reprojection:
        """The same with expected errors multiplied, for all landmarks or for each."""
        return replace(self, deviations=self.deviations * factors)

    def belief(self, points: Float[ndarray, "f n 3"]) -> Float[ndarray, "f v n"]:
        """Weight of each landmark relative to a perfect one."""
        return self.scores * _robust_weights(self.squared_errors(points)) * _FREEDOM / (_FREEDOM + 2)

    def noise_factors(self, points: Float[ndarray, "f n 3"]) -> Float[ndarray, " n"]:
        """Each landmark's typical error relative to the expected one, over all frames and views.

        One step of expectation and maximisation for the scale of Student's t, as though some landmarks had been seen
        with just the expected error.
        """
        squares = self.squared_errors(points)
        explained = (self.scores * _robust_weights(squares) * squares).sum((0, 1)) / 2
        count = self.scores.sum((0, 1))
        return np.sqrt((explained + _EXPECTED_COUNT) / (count + _EXPECTED_COUNT))


def _robust_weights(squared_errors: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """Weights of iteratively reweighted least squares for Student's t in two dimensions."""
    return (_FREEDOM + 2) / (_FREEDOM + squared_errors)
