"""Regions of an image over which figures are taken."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

BAND = 0.0125
"""Half the width of the band round the hair's edge, in longer sides of the image: 3 pixels of 256."""


def convex_region(points: Float[np.ndarray, "n 2"], width: int, height: int) -> Bool[np.ndarray, "_ _"]:
    """Select the pixels of an image whose centres lie in the convex hull of points.

    Args:
        points: in pixels; they may lie outside the image.
        width: of the image.
        height: of the image.

    Returns:
        (height, width); empty where the points have no hull, being too few, on one line, or not finite.
    """
    points = np.asarray(points, np.float64)
    try:
        planes = ConvexHull(points).equations
    except (QhullError, ValueError):
        return np.zeros((height, width), bool)
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    a, b, c = planes.T
    with np.errstate(divide="ignore", invalid="ignore"):  # of edges along a row, which have a = 0
        crossings = -(b * y[:, None] + c) / a
    first = np.where(a < 0, crossings, -np.inf).max(axis=1)
    last = np.where(a > 0, crossings, np.inf).min(axis=1)
    above_or_below = (y < points[:, 1].min()) | (y > points[:, 1].max())
    return (first[:, None] <= x) & (x <= last[:, None]) & ~above_or_below[:, None]


def boundary_band(silhouettes: Bool[Tensor, "v h w"]) -> Bool[Tensor, "v h w"]:
    """Select the pixels on both sides of each silhouette's edge, at most `BAND` away from it, but at least the next.

    The edge runs between a pixel inside and its neighbour outside, half a pixel from both. The border of the image is
    no edge.
    """
    reach = max(BAND * max(silhouettes.shape[1:]), 0.5) + 0.5
    return torch.stack([torch.from_numpy(_near_edge(silhouette.numpy(), reach)) for silhouette in silhouettes])


def dilated(region: Bool[Tensor, "v h w"], radius: int) -> Bool[Tensor, "v h w"]:
    """Grow regions by all pixels within ``radius`` pixels."""
    offset = np.arange(-radius, radius + 1)
    disk = (offset**2 + offset[:, None] ** 2 <= radius**2).astype(np.uint8)
    grown = [cv2.dilate(view.numpy().astype(np.uint8), disk) for view in region]
    return torch.from_numpy(np.stack(grown) > 0)


def _near_edge(silhouette: Bool[np.ndarray, "h w"], reach: float) -> Bool[np.ndarray, "h w"]:
    if silhouette.all() or not silhouette.any():
        return np.zeros_like(silhouette)
    # an exact transform, as SciPy's, in a tenth of its time
    inside, outside = (
        cv2.distanceTransform(side.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for side in (silhouette, ~silhouette)
    )
    return inside + outside <= reach
