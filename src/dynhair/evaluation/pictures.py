"""Pictures that put the avatar beside the truth: panels and maps of the error."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from dynhair.pictures import Picture

SMALL = 400
"""Images with fewer rows are shown at twice their size."""

LARGEST_ERROR = 0.5
"""Mean absolute error of a pixel's channels that the error map shows brightest."""

ERROR_COLOURS = np.array([[0, 0, 4], [87, 16, 110], [188, 55, 84], [249, 142, 9], [252, 255, 164]], np.float64)
"""Evenly spaced along the scale: dark to bright, so that it reads in grey as well."""


def picture(image: Float[Tensor, "h w 3"]) -> Picture:
    """Round an image in [0, 1] to 8 bits, and show a small one at twice its size."""
    return _enlarged(_rounded(image))


def enlarged_picture(image: Float[Tensor, "h w 3"], side: int) -> Picture:
    """Round an image in [0, 1] to 8 bits, and scale it to a square."""
    return np.asarray(Image.fromarray(_rounded(image)).resize((side, side), Image.Resampling.LANCZOS))


def fitted(shown: Picture, size: tuple[int, ...]) -> Picture:
    """Scale a picture to fit into a size (rows, columns), centred on black."""
    rows, columns = size
    scale = min(rows / shown.shape[0], columns / shown.shape[1])
    height, width = (max(1, round(scale * side)) for side in shown.shape[:2])
    whole = np.zeros((rows, columns, 3), np.uint8)
    top, left = (rows - height) // 2, (columns - width) // 2
    inside = Image.fromarray(shown).resize((width, height), Image.Resampling.LANCZOS)
    whole[top : top + height, left : left + width] = np.asarray(inside)
    return whole


def error_picture(image: Float[Tensor, "h w 3"], truth: Float[Tensor, "h w 3"]) -> Picture:
    """Colour the mean absolute error of a pixel's channels: black at 0, brightest from `LARGEST_ERROR`."""
    error = (image - truth).abs().mean(dim=-1).double().cpu().numpy()
    place = (error / LARGEST_ERROR).clip(0.0, 1.0) * (len(ERROR_COLOURS) - 1)
    stops = np.arange(len(ERROR_COLOURS))
    colours = np.stack([np.interp(place, stops, channel) for channel in ERROR_COLOURS.T], axis=-1)
    return _enlarged(colours.round().astype(np.uint8))


def _rounded(image: Float[Tensor, "h w 3"]) -> Picture:
    return (image.clamp(0.0, 1.0) * 255.0).round().byte().cpu().numpy()


def _enlarged(values: Picture) -> Picture:
    height, width = values.shape[:2]
    if height >= SMALL:
        return values
    return np.asarray(Image.fromarray(values).resize((2 * width, 2 * height), Image.Resampling.LANCZOS))
