"""Turned squares around faces, and the crops that networks look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

_MARGIN = 1.5  # side of the square over the face's extent, as the networks were trained


@dataclass(frozen=True)
class FaceSquare:
    """A square of an image with a face upright in it.

    Pixel centres are at (i + 0.5, j + 0.5).

    Attributes:
        centre: x and y in pixels.
        side: in pixels.
        angle: from the image's +x axis to the square's, towards +y (clockwise as seen), radians.
    """

    centre: tuple[float, float]
    side: float
    angle: float = 0.0

    @property
    def axes(self) -> Float[np.ndarray, "2 2"]:
        """The square's sides as columns, in pixels."""
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        return self.side * np.array([[cosine, -sine], [sine, cosine]])

    def to_image(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Points of the unit square, (0, 0) being its upper left corner, to pixels of the image."""
        return (points - 0.5) @ self.axes.T + self.centre

    def from_image(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Pixels of the image to points of the unit square."""
        return (points - np.asarray(self.centre)) @ self.axes / self.side**2 + 0.5

    def crop(self, image: UInt8[np.ndarray, "h w 3"], size: int) -> UInt8[np.ndarray, "size size 3"]:
        """What the square shows, resampled to ``size`` pixels a side; black beyond the image."""
        import cv2

        shrink = int(self.side // size)
        if shrink > 1:  # bilinear interpolation alone would skip pixels
            image, square = self._shrunk(image, shrink)
            return square.crop(image, size)
        linear = self.axes / size
        offset = self.to_image(np.full(2, 0.5 / size)) - 0.5  # OpenCV's pixel centres are at (i, j)
        return cv2.warpAffine(image, np.c_[linear, offset], (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)

    def _shrunk(self, image: UInt8[np.ndarray, "h w 3"], shrink: int) -> tuple[np.ndarray, FaceSquare]:
        """The image around the square, averaged over blocks of pixels, and the square in it."""
        import cv2

        corners = self.to_image(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]))
        limit = np.array(image.shape[1::-1])
        low = np.clip(np.floor(corners.min(0)).astype(int) - shrink, 0, limit)
        high = np.clip(np.ceil(corners.max(0)).astype(int) + shrink, 0, limit)
        blocks = (high - low) // shrink
        if blocks.min() == 0:  # the square lies beside the image
            small = np.zeros((1, 1, 3), np.uint8)
        else:
            x, y = low
            width, height = blocks * shrink
            small = cv2.resize(image[y : y + height, x : x + width], blocks.tolist(), interpolation=cv2.INTER_AREA)
        centre_x, centre_y = (np.asarray(self.centre) - low) / shrink
        return small, FaceSquare((float(centre_x), float(centre_y)), self.side / shrink, self.angle)


def square_around(points: Float[np.ndarray, "n 2"], right: int, left: int) -> FaceSquare:
    """The square that holds points of a face with the networks' usual margin.

    Args:
        points: in pixels.
        right: index of the point that is level with ``left`` on the person's right.
        left: index of the other.
    """
    across = points[left] - points[right]
    angle = float(np.arctan2(across[1], across[0]))
    turned = FaceSquare((0.0, 0.0), 1.0, angle)
    local = turned.from_image(points)
    low, high = local.min(0), local.max(0)
    x, y = turned.to_image((low + high) / 2)
    return FaceSquare((float(x), float(y)), _MARGIN * float((high - low).max()), angle)
