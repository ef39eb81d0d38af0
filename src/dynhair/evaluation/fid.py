"""The Frechet inception distance (Heusel et al., "GANs trained by a two time-scale update rule ...", 2017).

Features of two sets of images are each taken for a normal distribution N(m, C), of which the distance is

    |m1 - m2|^2 + Tr(C1 + C2 - 2 (C1 C2)^(1/2)).

With deviations from the mean as the rows of a matrix X, ``C = X^T X / (n - 1)``, and the last trace is the sum of the
singular values of ``X1 X2^T / sqrt((n1 - 1) (n2 - 1))``: no root of a matrix is taken, and a covariance that is
singular, as that of fewer images than features is, does no harm. Rows that are more than twice as many as the features
are replaced by the triangle of their QR decomposition, which has the same ``X^T X``: memory is bounded.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from torch import Tensor

FID_IMAGES = 24
"""Images of a test segment that are seen, spread over its frames and views: an image takes the network as long as seven
take AlexNet."""

LEAST_IMAGES = 2
"""Of fewer there is no covariance."""


class Moments:
    """Mean and covariance of features, in double precision.

    Args:
        width: number of features.

    Attributes:
        count: of the samples that were added.
        mean: of these.
        deviations: X, whose ``X^T X`` is the sum of the outer products of the samples' deviations from the mean.
    """

    def __init__(self, width: int) -> None:
        self.count = 0
        self.mean: Float[np.ndarray, " d"] = np.zeros(width)
        self.deviations: Float[np.ndarray, "r d"] = np.zeros((0, width))

    def add(self, features: Float[np.ndarray, "n d"]) -> None:
        """Add samples."""
        if len(features):
            batch = Moments(features.shape[1])
            batch.count, batch.mean = len(features), features.mean(axis=0, dtype=np.float64)
            batch.deviations = features - batch.mean
            self.merge(batch)

    def merge(self, other: Moments) -> None:
        """Add all samples that another has seen (Chan et al. 1979)."""
        if not other.count:
            return
        total = self.count + other.count
        apart = other.mean - self.mean
        between = math.sqrt(self.count * other.count / total) * apart[None]
        rows = [self.deviations, other.deviations, *([between] if self.count else [])]
        self.deviations = np.concatenate(rows)
        self.mean = self.mean + apart * (other.count / total)
        self.count = total
        if len(self.deviations) > 2 * len(self.mean):
            self.deviations = np.asarray(np.linalg.qr(self.deviations, mode="r"))

    def covariance(self) -> Float[np.ndarray, "d d"]:
        """The unbiased covariance."""
        return self.deviations.T @ self.deviations / (self.count - 1)


def frechet_distance(first: Moments, second: Moments) -> float:
    """The squared Frechet distance of two normal distributions; ``nan`` where one has fewer than two samples."""
    if min(first.count, second.count) < LEAST_IMAGES:
        return math.nan
    a, b = (moments.deviations / math.sqrt(moments.count - 1) for moments in (first, second))
    shared = np.linalg.svd(a @ b.T, compute_uv=False).sum()
    distance = np.square(first.mean - second.mean).sum() + np.square(a).sum() + np.square(b).sum() - 2.0 * shared
    return max(float(distance), 0.0)


class FidSums:
    """Images of a method and of the truth, as many of each, for their Frechet inception distance.

    Args:
        width: number of features.
    """

    def __init__(self, width: int = 2048) -> None:
        self._images, self._truth = Moments(width), Moments(width)

    @property
    def samples(self) -> int:
        """Over how many images of each the distance is taken."""
        return self._images.count

    def add(self, images: Float[Tensor, "v d"], truth: Float[Tensor, "v d"]) -> None:
        """Add features of the same views; a view where either has a ``nan`` is left out.

        Args:
            images: of the method.
            truth: of the truth.
        """
        defined = ~(images.isnan().any(dim=1) | truth.isnan().any(dim=1))
        self._images.add(images[defined].cpu().numpy())
        self._truth.add(truth[defined].cpu().numpy())

    def merge(self, other: FidSums) -> None:
        """Add all that ``other`` has seen."""
        self._images.merge(other._images)
        self._truth.merge(other._truth)

    def value(self) -> float | None:
        """The distance; None of fewer than `LEAST_IMAGES`."""
        distance = frechet_distance(self._images, self._truth)
        return None if math.isnan(distance) else distance
