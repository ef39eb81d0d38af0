"""FLIP, the difference that is seen when two images alternate, for images of low dynamic range.

The source is Andersson et al., "FLIP: a difference evaluator for alternating images", 2020. Colours are blurred by the
eye's contrast sensitivity and compared in a perceptual space; edges and points that only one image has raise the
difference. The map is in [0, 1] at each pixel. The numbers below are the paper's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, partial

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dynhair import threads

PIXELS_PER_DEGREE = 0.7 * 3840 / 0.7 * math.pi / 180
"""Of visual angle, 67.02: an observer 0.7 m from a screen of 3840 pixels in 0.7 m, as in the paper."""

_RGB_TO_XYZ = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
_WHITE = _RGB_TO_XYZ.sum(axis=1)
# luma, red-green and blue-yellow, linear in XYZ relative to the white
_TO_OPPONENT = np.array([[0.0, 116.0, 0.0], [500.0, -500.0, 0.0], [0.0, 200.0, -200.0]])
_OPPONENT = _TO_OPPONENT @ (_RGB_TO_XYZ / _WHITE[:, None])
_FROM_OPPONENT = np.linalg.inv(_OPPONENT)
_SENSITIVITY = (((1.0, 0.0047),), ((1.0, 0.0053),), ((34.1, 0.04), (13.5, 0.025)))
_WIDEST = 0.04
_FEATURE_WIDTH = 0.082
_COLOUR_EXPONENT, _FEATURE_EXPONENT = 0.7, 0.5
_KNEE, _KNEE_VALUE = 0.4, 0.95


@dataclass(frozen=True)
class FlipView:
    """What the eye makes of an image.

    Attributes:
        colours: L, a, b after Hunt's adjustment, blurred by the contrast sensitivity.
        features: strength of edges and of points.
    """

    colours: Float[np.ndarray, "h w 3"]
    features: tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]


def flip(images: Float[Tensor, "v h w 3"], truth: Float[Tensor, "v h w 3"]) -> Float[Tensor, " v"]:
    """Mean FLIP of each view, at `PIXELS_PER_DEGREE`.

    Args:
        images: sRGB in [0, 1].
        truth: in the same form.

    Returns:
        In [0, 1]; 0 for equal images.
    """
    return flip_between(flip_views(images), flip_views(truth))


def flip_views(images: Float[Tensor, "v h w 3"]) -> list[FlipView]:
    """What is compared; that of a truth can be kept."""
    seen: list[FlipView | None] = [None] * len(images)

    def look(view: int) -> None:
        seen[view] = _view(images[view].cpu().numpy().astype(np.float32))

    threads.run([partial(look, view) for view in range(len(images))])
    return [view for view in seen if view is not None]


def flip_between(first: list[FlipView], second: list[FlipView]) -> Float[Tensor, " v"]:
    """Mean FLIP of views that are given as `flip_views` makes them."""
    return torch.tensor([float(flip_map(a, b).mean()) for a, b in zip(first, second, strict=True)])


def flip_map(first: FlipView, second: FlipView) -> Float[np.ndarray, "h w"]:
    """FLIP of each pixel."""
    colour = _difference(first.colours, second.colours) ** _COLOUR_EXPONENT
    most = _most_colour_difference()
    knee = _KNEE * most
    colour = np.where(
        colour < knee,
        _KNEE_VALUE / knee * colour,
        _KNEE_VALUE + (colour - knee) / (most - knee) * (1.0 - _KNEE_VALUE),
    )
    apart = (np.abs(a - b) for a, b in zip(first.features, second.features, strict=True))
    feature = (np.maximum(*apart) / math.sqrt(2.0)) ** _FEATURE_EXPONENT
    return colour ** (1.0 - feature)


def _view(image: Float[np.ndarray, "h w 3"]) -> FlipView:
    linear = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4).astype(np.float32)
    opponent = cv2.transform(linear, _OPPONENT.astype(np.float32))
    blurred = np.stack([_blurred(opponent[..., channel], channel) for channel in range(3)], axis=-1)
    seen = cv2.transform(blurred, _FROM_OPPONENT.astype(np.float32)).clip(0.0, 1.0)
    luma = opponent[..., 0] / 116.0  # in [0, 1]
    return FlipView(_hunt_lab(seen), _features(luma))


def _blurred(channel: Float[np.ndarray, "h w"], number: int) -> Float[np.ndarray, "h w"]:
    return np.sum([weight * _filtered(channel, bell, bell) for weight, bell in _sensitivity(number)], axis=0)


def _features(luma: Float[np.ndarray, "h w"]) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    bell, *derivatives = _feature_filters()
    edges, points = (
        cv2.magnitude(_filtered(luma, filter_, bell), _filtered(luma, bell, filter_)) for filter_ in derivatives
    )
    return edges, points


def _filtered(
    image: Float[np.ndarray, "h w"], across: Float[np.ndarray, " k"], down: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "h w"]:
    return cv2.sepFilter2D(image, -1, across, down, borderType=cv2.BORDER_REPLICATE)


def _hunt_lab(linear: Float[np.ndarray, "*p 3"]) -> Float[np.ndarray, "*p 3"]:
    """CIELAB whose chroma fades with the lightness."""
    relative = linear @ (_RGB_TO_XYZ / _WHITE[:, None]).T.astype(np.float32)
    delta = 6.0 / 29.0
    root = np.where(relative > delta**3, np.cbrt(relative), relative / (3.0 * delta**2) + 4.0 / 29.0)
    lightness = 116.0 * root[..., 1] - 16.0
    chroma = (500.0 * (root[..., 0] - root[..., 1]), 200.0 * (root[..., 1] - root[..., 2]))
    return np.stack([lightness, *(0.01 * lightness * part for part in chroma)], axis=-1)


def _difference(first: Float[np.ndarray, "*p 3"], second: Float[np.ndarray, "*p 3"]) -> Float[np.ndarray, "*p"]:
    """HyAB: city-block of lightness, Euclidean in chroma."""
    lightness, a, b = np.moveaxis(first - second, -1, 0)
    return np.abs(lightness) + np.hypot(a, b)


@lru_cache(maxsize=1)
def _most_colour_difference() -> float:
    green_and_blue = _hunt_lab(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    return _difference(green_and_blue[:1], green_and_blue[1:]).item() ** _COLOUR_EXPONENT


@lru_cache(maxsize=3)
def _sensitivity(channel: int) -> list[tuple[float, Float[np.ndarray, " k"]]]:
    """Weights and one-dimensional bells whose products add up to the filter of an opponent channel."""
    radius = math.ceil(3.0 * math.sqrt(_WIDEST / (2.0 * math.pi**2)) * PIXELS_PER_DEGREE)
    degrees = np.arange(-radius, radius + 1) / PIXELS_PER_DEGREE
    terms = [
        (height * math.sqrt(math.pi / width), np.exp(-(math.pi**2) * degrees**2 / width))
        for height, width in _SENSITIVITY[channel]
    ]
    total = sum(weight * bell.sum() ** 2 for weight, bell in terms)
    return [(weight / total, bell) for weight, bell in terms]


@lru_cache(maxsize=1)
def _feature_filters() -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """A bell, and its first and second derivative with positive and negative weights that each add up to one."""
    deviation = 0.5 * _FEATURE_WIDTH * PIXELS_PER_DEGREE
    radius = math.ceil(3.0 * deviation)
    place = np.arange(-radius, radius + 1)
    bell = np.exp(-(place**2) / (2.0 * deviation**2))
    edge, point = -place * bell, (place**2 / deviation**2 - 1.0) * bell
    edge, point = (
        np.where(slope > 0.0, slope / slope[slope > 0.0].sum(), -slope / slope[slope < 0.0].sum())
        for slope in (edge, point)
    )
    return bell / bell.sum(), edge, point
