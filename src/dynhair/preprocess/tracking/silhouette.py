"""The body's masks: no part of the bare head may stick out of them.

Hair hides the skull's outline, so that a mask says nothing of points inside of it. Points outside of it pay for their
distance, and only those: face, ears and neck are held in, and robustly so, because masks have holes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray

from dynhair.face import FaceModel
from dynhair.preprocess.tracking.reprojection import PointTerm, project

_LONGEST_SIDE = 256  # of the distance maps, pixels
_STEPS = 8  # of distance in a pixel of the map
_FREEDOM = 3.0
_MOST_VERTICES = 300


@dataclass(frozen=True)
class Silhouettes:
    """Distances to the body in all views of a take, as a cost of where the points of the head are.

    Attributes:
        distances: from each pixel of a reduced picture to the body, in eighths of such a pixel; 0 within the body.
        reduction: pixels of the reduced picture per pixel of the picture.
        deviations: expected error of masks, pixels of the picture.
        w2c: world-to-camera, metres.
        K: intrinsics in pixels of the picture.
    """

    distances: UInt8[ndarray, "f v h w"]
    reduction: float
    deviations: Float[ndarray, "f v"]
    w2c: Float[ndarray, "f v 3 4"]
    K: Float[ndarray, "f v 3 3"]

    @classmethod
    def of_masks(
        cls,
        mask: Callable[[int, int], UInt8[ndarray, "h w"]],
        deviations: Float[ndarray, "f v"],
        w2c: Float[ndarray, "f v 3 4"],
        K: Float[ndarray, "f v 3 3"],
    ) -> Silhouettes:
        """Measure distances.

        Args:
            mask: coverage by the body in a frame (0, 1, ...) and view, all of one size.
            deviations: expected error of masks, pixels.
            w2c: world-to-camera, metres.
            K: intrinsics in pixels.
        """
        import cv2

        height, width = mask(0, 0).shape
        reduction = min(1.0, _LONGEST_SIDE / max(height, width))
        size = round(width * reduction), round(height * reduction)

        def distances(frame: int, view: int) -> UInt8[ndarray, "h w"]:
            small = cv2.resize(mask(frame, view), size, interpolation=cv2.INTER_AREA)
            outside = (small < 128).astype(np.uint8)
            if outside.all():  # nobody was found
                return np.zeros(size[::-1], np.uint8)
            return np.minimum(cv2.distanceTransform(outside, cv2.DIST_L2, 5) * _STEPS, 255).astype(np.uint8)

        frames, views = deviations.shape
        maps = np.stack([np.stack([distances(f, v) for v in range(views)]) for f in range(frames)])
        return cls(maps, reduction, deviations, w2c, K)

    def cost(self, points: Float[ndarray, "f n 3"]) -> float:
        """Negative log-likelihood."""
        pixels = project(points, self.w2c, self.K)[0]
        distance = self._sampled(pixels)[0] / self.deviations[..., None]
        return float(((_FREEDOM + 1) / 2 * np.log1p(distance**2 / _FREEDOM)).sum())

    def linearised(self, points: Float[ndarray, "f n 3"]) -> PointTerm:
        """Gradient and Gauss-Newton curvature of the cost with iteratively reweighted distances."""
        pixels, slopes = project(points, self.w2c, self.K)
        distance, uphill = self._sampled(pixels)
        variance = self.deviations[..., None] ** 2
        weights = (_FREEDOM + 1) / (_FREEDOM + distance**2 / variance) / variance
        normal = (uphill[..., None, :] @ slopes)[..., 0, :]
        gradient = np.einsum("fvn,fvni->fni", weights * distance, normal)
        return gradient, np.einsum("fvn,fvni,fvnj->fnij", weights, normal, normal)

    def _sampled(self, pixels: Float[ndarray, "f v n 2"]) -> tuple[Float[ndarray, "f v n"], Float[ndarray, "f v n 2"]]:
        """Bilinear distance in pixels of the picture and its slope; nought beyond the picture's border."""
        height, width = self.distances.shape[2:]
        place = pixels * self.reduction - 0.5
        within = np.all((place >= 0) & (place < [width - 1, height - 1]), axis=-1)
        place = np.where(within[..., None], place, 0.0)
        corner = place.astype(np.int64)
        x, y = np.moveaxis(place - corner, -1, 0)
        frames, views = self.deviations.shape
        frame, view = np.arange(frames)[:, None, None], np.arange(views)[:, None]

        def at(right: int, down: int) -> Float[ndarray, "f v n"]:
            found = self.distances[frame, view, corner[..., 1] + down, corner[..., 0] + right]
            return np.where(within, found / (_STEPS * self.reduction), 0.0)

        a, b, c, d = at(0, 0), at(1, 0), at(0, 1), at(1, 1)
        along, across = b - a, c - a
        bend = d - c - along
        distance = a + x * along + y * across + x * y * bend
        slope = np.stack([along + y * bend, across + x * bend], -1)
        return distance, slope * self.reduction


def skin_vertices(model: FaceModel) -> Int[ndarray, " n"]:
    """Some vertices, evenly taken, that move with the head and are not under hair."""
    bare = model.head_weight.numpy() > 0.9
    bare[model.faces[model.scalp].numpy().ravel()] = False
    vertices = np.flatnonzero(bare)
    return vertices[:: -(-len(vertices) // _MOST_VERTICES)]
