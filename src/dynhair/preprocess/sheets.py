"""Contact sheets: what a step made of some frames of every segment, in several views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from dynhair.pictures import Picture, grid
from dynhair.preprocess.workspace import STATIC, ViewId, Workspace
from dynhair.storage import atomic_file

_ROWS = 8
_COLUMNS = 6
_CELL = 256
"""Longer side of a picture on a sheet, pixels."""


def write_sheet(workspace: Workspace, path: Path, picture: Callable[[ViewId], Picture | None]) -> None:
    """Write a contact sheet as JPEG; none if there are no pictures.

    Args:
        workspace: says which views there are.
        path: of the sheet.
        picture: draws one view in its image's size, or returns None.
    """
    rows = sample_views(workspace)
    pictures = [[picture(view) for view in row] for row in rows]
    shown = [
        (row, [_fitted(cell) for cell in cells if cell is not None]) for row, cells in zip(rows, pictures, strict=True)
    ]
    shown = [(row, cells) for row, cells in shown if cells]
    if not shown:
        return
    columns = max(len(cells) for _, cells in shown)
    blank = np.zeros_like(shown[0][1][0])
    sheet = grid(
        [[*cells, *[blank] * (columns - len(cells))] for _, cells in shown],
        [_label(workspace, row[0]) for row, _ in shown],
        list(spread(workspace.manifest.camera_names, _COLUMNS))
        + [""] * (columns - len(workspace.manifest.camera_names)),
    )
    with atomic_file(path) as temporary:
        Image.fromarray(sheet).save(temporary, quality=90)


def sample_views(workspace: Workspace) -> list[list[ViewId]]:
    """Choose rows of views: frames spread over all segments, and one row of the static ring."""
    manifest = workspace.manifest
    names = spread(manifest.camera_names, _COLUMNS)
    each = max(1, _ROWS // len(manifest.segments))
    frames = [
        segment.frames[int((i + 0.5) / each * segment.count)]
        for segment in spread(manifest.segments, _ROWS)
        for i in range(each)
    ]
    rows = [[ViewId(frame, name) for name in names] for frame in dict.fromkeys(frames)]
    if workspace.static_names:
        rows.append([ViewId(STATIC, name) for name in spread(workspace.static_names, len(names))])
    return rows


def spread(items: Sequence, count: int) -> list:
    """At most so many items, evenly spread over all."""
    count = min(count, len(items))
    return [items[int((i + 0.5) / count * len(items))] for i in range(count)]


def tinted(
    image: UInt8[np.ndarray, "h w 3"], coverage: UInt8[np.ndarray, "h w"], colour: tuple[int, int, int]
) -> UInt8[np.ndarray, "h w 3"]:
    """Lay a colour over an image where something covers it, and draw the edge of it."""
    alpha = coverage[..., None].astype(np.float32) / 255 * 0.45
    mixed = image * (1 - alpha) + np.array(colour, np.float32) * alpha
    result = np.ascontiguousarray(mixed.round().astype(np.uint8))
    outlines, _ = cv2.findContours((coverage > 127).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(result, outlines, -1, colour, max(1, image.shape[0] // 400))
    return result


def hue(angle: Float[np.ndarray, "h w"], strength: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Undirected angles in units of pi as hues, as bright as they are strong: red along x, cyan along y."""
    value = (np.clip(strength, 0, 1) * 255).astype(np.uint8)
    pixels = np.stack([(angle * 180 % 180).astype(np.uint8), np.full_like(value, 255), value], -1)
    return cv2.cvtColor(pixels, cv2.COLOR_HSV2RGB)


def _fitted(picture: Picture) -> Picture:
    height, width = picture.shape[:2]
    scale = _CELL / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)


def _label(workspace: Workspace, view: ViewId) -> str:
    if view.is_static:
        return "static ring"
    names = [segment.name for segment in workspace.manifest.segments if view.frame in segment.frames]
    return f"{names[0]} {view.frame}"
