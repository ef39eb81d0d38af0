"""Grids of pictures with labels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

Picture = UInt8[np.ndarray, "_ _ 3"]

PAPER = (17, 18, 20)
INK = (235, 235, 235)


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
