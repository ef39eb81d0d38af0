"""Bringing an image into the frame that a network wants, and the network's matte back."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float, UInt8

Predict = Callable[[Float[np.ndarray, "h w 3"]], Float[np.ndarray, "h w"]]
"""A network: an image in its own range of values to alpha in [0, 1], of the same size."""


def letterboxed(predict: Predict, image: UInt8[np.ndarray, "h w 3"], size: int) -> UInt8[np.ndarray, "h w"]:
    """Run a network on the image within a black square of ``size`` pixels, values in [0, 1]."""
    height, width = image.shape[:2]
    scale = size / max(height, width)
    inner = resized(image, (max(1, round(scale * height)), max(1, round(scale * width))))
    rows, columns = inner.shape[:2]
    top, left = (size - rows) // 2, (size - columns) // 2
    square = np.zeros((size, size, 3), np.float32)
    square[top : top + rows, left : left + columns] = inner / np.float32(255)
    return as_coverage(predict(square)[top : top + rows, left : left + columns], (height, width))


def stretched(
    predict: Predict, image: UInt8[np.ndarray, "h w 3"], size: tuple[int, int], centre: float, scale: float
) -> UInt8[np.ndarray, "h w"]:
    """Run a network on the image resized to ``size`` (height, width), values ``(x - centre) / scale`` of 0 to 255."""
    values = (resized(image, size).astype(np.float32) - np.float32(centre)) / np.float32(scale)
    return as_coverage(predict(values), image.shape[:2])


def resized(image: UInt8[np.ndarray, "h w 3"], size: tuple[int, int]) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Resize to height and width: means of areas where it shrinks, bilinear where it grows."""
    shrinks = size[0] * size[1] < image.shape[0] * image.shape[1]
    return cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)


def as_coverage(alpha: Float[np.ndarray, "h w"], size: tuple[int, int]) -> UInt8[np.ndarray, "h2 w2"]:
    """Resize alpha to height and width, 0 to 255."""
    shrinks = size[0] * size[1] < alpha.size
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    alpha = cv2.resize(np.ascontiguousarray(alpha, np.float32), size[::-1], interpolation=method)
    return np.rint(255 * np.clip(alpha, 0, 1)).astype(np.uint8)
