"""How far an image's edges have moved, to a twentieth of a pixel (Lucas and Kanade 1981).

Around each pixel one displacement u and one change of brightness b, weighted by a Gaussian window, explain the second
image I_t by the first I_0,

    min over u, b of <(I_t(x + u) - I_0(x) - b)^2>,

linearised by the first image's gradient and solved a few times. The change of brightness takes up the shadows that a
moving head casts on a resting body (Negahdaripour 1998 has it for the same reason). Along a straight edge motion cannot
be seen: what counts is the displacement across, u . g / |g|.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch.nn.functional import grid_sample

EDGE = 0.03
"""Change of luma a pixel, in the smoothed first image, from which on a pixel belongs to an edge."""

SMOOTHING = 1.0
"""Standard deviation of the Gaussian that both images are smoothed by, pixels."""

WINDOW = 2.5
"""Standard deviation of the window that is taken to move as one, pixels."""

STEPS = 2
"""Solutions of the linearised problem, each from where the last has led: a third changes shifts of a pixel by 0.01."""

FURTHEST = 5.0
"""Pixels of displacement that count at most: what lies beyond the window's reach is not found."""

_LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)
_LEAST_STRUCTURE = 1e-5


class EdgeMotion:
    """Compares images with a first one.

    Args:
        first: in [0, 1].

    Attributes:
        edges: the first image's edges.
    """

    edges: Bool[np.ndarray, "h w"]

    def __init__(self, first: Float[np.ndarray, "h w 3"]) -> None:
        self._first = _smooth_luma(first)
        self._gy, self._gx = np.gradient(self._first)
        self._mean_gx, self._mean_gy = _window(self._gx), _window(self._gy)
        self._xx = _window(self._gx**2) - self._mean_gx**2 + _LEAST_STRUCTURE
        self._yy = _window(self._gy**2) - self._mean_gy**2 + _LEAST_STRUCTURE
        self._xy = _window(self._gx * self._gy) - self._mean_gx * self._mean_gy
        self._steepness = np.hypot(self._gx, self._gy)
        self.edges = self._steepness > EDGE

    def distances(self, image: Float[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
        """How far each pixel has moved across its edge, pixels; ``nan`` where the first image has no edge.

        Args:
            image: of the first image's size, in [0, 1].
        """
        later = _smooth_luma(image)
        u, v = np.zeros_like(later), np.zeros_like(later)
        determinant = self._xx * self._yy - self._xy**2
        for step in range(STEPS):
            change = (_sampled(later, u, v) if step else later) - self._first
            mean = _window(change)
            along_x = _window(self._gx * change) - self._mean_gx * mean
            along_y = _window(self._gy * change) - self._mean_gy * mean
            u = (u - (self._yy * along_x - self._xy * along_y) / determinant).clip(-FURTHEST, FURTHEST)
            v = (v - (self._xx * along_y - self._xy * along_x) / determinant).clip(-FURTHEST, FURTHEST)
        across = np.abs(u * self._gx + v * self._gy) / np.maximum(self._steepness, EDGE)
        return np.where(self.edges, across.clip(0, FURTHEST), np.nan).astype(np.float32)


def _sampled(
    image: Float32[np.ndarray, "h w"], u: Float32[np.ndarray, "h w"], v: Float32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w"]:
    """The image at (x + u, y + v), linear: the usual cubic kernel (a = -0.75) bends ramps, which biases motion.

    OpenCV's remap would round places to a 32nd of a pixel.
    """
    height, width = image.shape
    rows, columns = np.indices(image.shape, np.float32)
    places = np.stack([(columns + u) * (2 / (width - 1)) - 1, (rows + v) * (2 / (height - 1)) - 1], axis=-1)
    values = grid_sample(
        torch.from_numpy(image)[None, None],
        torch.from_numpy(places)[None],
        mode="bilinear",
        padding_mode="border",
        align_corners=True,
    )
    return values[0, 0].numpy()


def _smooth_luma(image: Float[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
    return _blurred(image.astype(np.float32) @ _LUMA, SMOOTHING)


def _window(values: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    return _blurred(values, WINDOW)


def _blurred(values: Float32[np.ndarray, "h w"], deviation: float) -> Float32[np.ndarray, "h w"]:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), deviation, borderType=cv2.BORDER_REFLECT))
