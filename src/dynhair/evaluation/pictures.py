"""Pictures that put the avatar beside the truth: panels, labels, maps of the error, contact sheets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

Picture = UInt8[np.ndarray, "_ _ 3"]

SMALL = 400
"""Images with fewer rows are shown at twice their size."""

LARGEST_ERROR = 0.5
"""Mean absolute error of a pixel's channels that the error map shows brightest."""

PAPER = (17, 18, 20)
INK = (235, 235, 235)
ERROR_COLOURS = np.array([[0, 0, 4], [87, 16, 110], [188, 55, 84], [249, 142, 9], [252, 255, 164]], np.float64)
"""Evenly spaced along the scale: dark to bright, so that it reads in grey as well."""


def picture(image: Float[Tensor, "h w 3"]) -> Picture:
    """Round an image in [0, 1] to 8 bits, and show a small one at twice its size."""
    values = (image.clamp(0.0, 1.0) * 255.0).round().byte().cpu().numpy()
    return _enlarged(values)


def error_picture(image: Float[Tensor, "h w 3"], truth: Float[Tensor, "h w 3"]) -> Picture:
    """Colour the mean absolute error of a pixel's channels: black at 0, brightest from `LARGEST_ERROR`."""
    error = (image - truth).abs().mean(dim=-1).double().cpu().numpy()
    place = (error / LARGEST_ERROR).clip(0.0, 1.0) * (len(ERROR_COLOURS) - 1)
    stops = np.arange(len(ERROR_COLOURS))
    colours = np.stack([np.interp(place, stops, channel) for channel in ERROR_COLOURS.T], axis=-1)
    return _enlarged(colours.round().astype(np.uint8))


def grid(rows: Sequence[Sequence[Picture]], row_labels: Sequence[str], column_labels: Sequence[str]) -> Picture:
    """Set pictures of one size in a grid, columns labelled above and rows at the left.

    Args:
        rows: the pictures, row by row.
        row_labels: one a row; no margin is left for them where all are empty.
        column_labels: one a column.
    """
    height, width = rows[0][0].shape[:2]
    gap = max(2, height // 64)
    text_size = max(11, height // 20)
    font = ImageFont.load_default(text_size)
    line = 2 * text_size
    margin = max(int(font.getlength(label)) for label in row_labels)
    left = margin + line if margin else gap
    sheet = Image.new(
        "RGB", (left + len(column_labels) * (width + gap), line + len(rows) * (height + gap)), color=PAPER
    )
    draw = ImageDraw.Draw(sheet)
    for column, label in enumerate(column_labels):
        draw.text((left + column * (width + gap) + width / 2, line / 2), label, INK, font, anchor="mm")
    for row, (pictures, label) in enumerate(zip(rows, row_labels, strict=True)):
        top = line + row * (height + gap)
        draw.text((left - line / 2, top + height / 2), label, INK, font, anchor="rm")
        for column, cell in enumerate(pictures):
            sheet.paste(Image.fromarray(cell), (left + column * (width + gap), top))
    return np.asarray(sheet)


def _enlarged(values: Picture) -> Picture:
    height, width = values.shape[:2]
    if height >= SMALL:
        return values
    return np.asarray(Image.fromarray(values).resize((2 * width, 2 * height), Image.Resampling.LANCZOS))
