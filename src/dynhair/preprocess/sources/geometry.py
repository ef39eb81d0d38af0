"""From pictures as they were filmed to those of a capture: without distortion, cropped, resized, and K with them."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float64, UInt8

from dynhair.errors import DynhairError
from dynhair.preprocess.options import Crop, Size
from dynhair.preprocess.sources.recording import SourceCamera

_ASPECT_TOLERANCE = 0.01
_HALF = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # OpenCV has pixel centres at whole numbers


class Rectifier:
    """Undistorts, crops and resizes the pictures of one camera.

    Args:
        camera: as it was calibrated.
        stored: width and height of the pictures; K is scaled to them.
        crop: x, y, width and height in pixels of the pictures without distortion; ``square`` for the largest in the
            middle; None for all.
        size: width and height of the result, or the length of its longer side; None for those of the crop.

    Raises:
        DynhairError: the crop is not inside the picture, or a shape does not fit another.
    """

    def __init__(self, camera: SourceCamera, stored: tuple[int, int], crop: Crop = None, size: Size = None) -> None:
        self._stored = stored
        self._distortion, self._fisheye = camera.distortion, camera.fisheye
        self._distorts = camera.fisheye or bool(camera.distortion.any())  # a fisheye does with zeros too
        self._source_K = _scaled(camera.K, stored, camera.size) if camera.size else camera.K
        self._crop = crop_box(crop, stored)
        self.size = _resized(self._crop[2:], size)

    @property
    def K(self) -> Float64[np.ndarray, "3 3"]:
        """Intrinsics of the result."""
        return _scaled(self._cropped_K, self.size, self._crop[2:])

    @property
    def is_identity(self) -> bool:
        """Whether pictures stay as they are."""
        return not self._distorts and self._crop == (0, 0, *self._stored) and self.size == self._stored

    def __call__(self, pixels: UInt8[np.ndarray, "h w *c"]) -> UInt8[np.ndarray, "v u *c"]:
        """Bring a picture, or a map of it, to the result's geometry; what the lens did not see becomes 0."""
        import cv2

        x, y, width, height = self._crop
        if self._distorts:
            pixels = cv2.remap(pixels, *self._maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)
        else:
            pixels = pixels[y : y + height, x : x + width]
        if self.size != (width, height):
            shrinks = self.size[0] < width
            pixels = cv2.resize(pixels, self.size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC).astype(
                np.uint8, copy=False
            )
        return np.ascontiguousarray(pixels)

    @property
    def _cropped_K(self) -> Float64[np.ndarray, "3 3"]:
        x, y = self._crop[:2]
        return self._source_K - [[0, 0, x], [0, 0, y], [0, 0, 0]]

    @cached_property
    def _maps(self) -> tuple[np.ndarray, np.ndarray]:
        """Where in the stored picture each pixel of the crop is."""
        import cv2

        initialise = cv2.fisheye.initUndistortRectifyMap if self._fisheye else cv2.initUndistortRectifyMap
        source, target = self._source_K - _HALF, self._cropped_K - _HALF
        return initialise(source, self._distortion, np.eye(3), target, self._crop[2:], cv2.CV_32FC1)


def crop_box(crop: Crop, stored: tuple[int, int]) -> tuple[int, int, int, int]:
    """Resolve a crop to x, y, width and height."""
    width, height = stored
    if crop is None:
        return (0, 0, width, height)
    if crop == "square":
        side = min(width, height)
        return ((width - side) // 2, (height - side) // 2, side, side)
    x, y, w, h = crop
    if not (x >= 0 and y >= 0 and w > 0 and h > 0 and x + w <= width and y + h <= height):
        raise DynhairError(
            f"the crop {x}, {y}, {w}, {h} is not inside pictures of {width} x {height}",
            expected="x, y, width, height in pixels",
        )
    return (x, y, w, h)


def _resized(shape: tuple[int, int], size: Size) -> tuple[int, int]:
    if size is None:
        return shape
    if isinstance(size, int):
        scale = size / max(shape)
        return (max(1, round(shape[0] * scale)), max(1, round(shape[1] * scale)))
    _require_aspect(size, shape, f"a size of {size[0]} x {size[1]} would stretch pictures of {shape[0]} x {shape[1]}")
    return size


def _scaled(K: np.ndarray, to: tuple[int, int], of: tuple[int, int]) -> np.ndarray:
    _require_aspect(to, of, f"pictures of {to[0]} x {to[1]} do not fit a calibration for {of[0]} x {of[1]}")
    return np.diag([to[0] / of[0], to[1] / of[1], 1.0]) @ K


def _require_aspect(size: tuple[int, int], other: tuple[int, int], message: str) -> None:
    slack = max(1 / min(size), 1 / min(other), _ASPECT_TOLERANCE)  # a side is rounded to whole pixels
    if abs(size[0] * other[1] / (size[1] * other[0]) - 1) > slack:
        raise DynhairError(message, expected="the same shape", mend="crop first, or calibrate for this size")
