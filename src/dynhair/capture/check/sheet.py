"""A contact sheet: some frames of every segment in every view, with landmarks and the head's axes drawn in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from dynhair.camera import Camera
from dynhair.capture.reader import Capture
from dynhair.capture.records import HeadTrack, Segment, View
from dynhair.errors import DynhairError
from dynhair.storage import atomic_file

_ROWS = 6
_COLUMNS = 6
_CELL = 240  # pixels
_GAP = 6
_LABEL = 132
_HEADER = 64
_AXIS_LENGTH = 0.08  # metres
_PAPER, _INK, _FAINT = (24, 25, 28), (232, 232, 236), (138, 140, 148)
_SPLITS = {"train": (106, 176, 255), "test": (255, 170, 84)}
_AXES = {"x": (255, 84, 84), "y": (92, 214, 92), "z": (90, 140, 255)}
_LANDMARK = (255, 224, 90)
_SMOOTH = 2  # drawn so many times larger, then reduced


def contact_sheet(capture: Capture, out_path: Path | str) -> None:
    """Draw the sheet as a PNG.

    Frames are spread over each segment, cameras over the list of cameras. Axes of the head at its origin, 8 cm long: x
    red, y green, z blue. What cannot be read leaves its cell empty, with the reason in it.

    Args:
        capture: what to draw.
        out_path: where to write it.
    """
    names = _spread(capture.camera_names, _COLUMNS)
    per_row = _COLUMNS // len(names)
    rows = _chosen_frames(capture.segments, per_row)
    columns = per_row * len(names)
    height = _HEADER + (len(rows) + bool(capture.static_names)) * (_CELL + _GAP)
    sheet = Image.new("RGB", (_LABEL + columns * (_CELL + _GAP), height), _PAPER)
    _draw_header(sheet, capture, names * per_row)
    for row, (segment, frames) in enumerate(rows):
        top = _HEADER + row * (_CELL + _GAP)
        _draw_label(sheet, top, segment.name, f"{segment.count} frames", segment.split, _SPLITS[segment.split])
        for column, (frame, name) in enumerate((frame, name) for frame in frames for name in names):
            cell = _frame_cell(capture, segment, frame, name)
            _draw_caption(cell, f"frame {frame}" if name == names[0] else "")
            sheet.paste(cell, (_LABEL + column * (_CELL + _GAP), top))
    if capture.static_names:
        top = _HEADER + len(rows) * (_CELL + _GAP)
        _draw_label(
            sheet, top, "static ring", f"{len(capture.static_names)} views", f"frame {capture.static_frame}", _FAINT
        )
        for column, name in enumerate(_spread(capture.static_names, columns)):
            cell = _static_cell(capture, name)
            _draw_caption(cell, f"view {name}")
            sheet.paste(cell, (_LABEL + column * (_CELL + _GAP), top))
    with atomic_file(out_path) as temporary:
        sheet.save(temporary, format="PNG")


def _chosen_frames(segments: Sequence[Segment], per_row: int) -> list[tuple[Segment, list[int]]]:
    """Choose rows of frames, one for each segment or more; not the first frames, where most heads are at rest."""
    rows = []
    for segment in segments:
        count = min(segment.count, per_row * max(1, _ROWS // len(segments)))
        frames = [segment.frames[int((i + 0.5) / count * segment.count)] for i in range(count)]
        rows += [(segment, frames[i : i + per_row]) for i in range(0, count, per_row)]
    return rows


def _spread(names: Sequence[str], count: int) -> list[str]:
    count = min(count, len(names))
    return [names[round(float(i))] for i in np.linspace(0, len(names) - 1, count)]


def _frame_cell(capture: Capture, segment: Segment, frame: int, name: str) -> Image.Image:
    try:
        view, camera = capture.view(frame, name), capture.camera(frame, name)
        landmarks, track = capture.landmarks_3d(frame), capture.track(segment)
    except DynhairError as error:
        return _empty_cell(error)
    return _annotated(view, camera, landmarks, track, frame - segment.start)


def _static_cell(capture: Capture, name: str) -> Image.Image:
    try:
        view, camera = capture.static_view(name), capture.static_camera(name)
        track = capture.track(Segment("static", capture.static_frame, 1, "train"))
    except DynhairError as error:
        return _empty_cell(error)
    return _annotated(view, camera, None, track, 0)


def _annotated(view: View, camera: Camera, landmarks: np.ndarray | None, track: HeadTrack, index: int) -> Image.Image:
    side = _CELL * _SMOOTH
    scale = side / max(camera.width, camera.height)
    picture = Image.fromarray(view.rgb.mul(255).round().byte().numpy())
    cell = Image.new("RGB", (side, side), (0, 0, 0))
    offset = np.array([side - camera.width * scale, side - camera.height * scale]) / 2
    size = (round(camera.width * scale), round(camera.height * scale))
    cell.paste(picture.resize(size, Image.Resampling.BICUBIC), (int(offset[0]), int(offset[1])))
    draw = ImageDraw.Draw(cell)

    def pixels(points: np.ndarray) -> list[tuple[float, float]]:
        projected = camera.project(torch.from_numpy(points.astype(np.float32)))[0].numpy() * scale + offset
        return [(float(x), float(y)) for x, y in projected.clip(-side, 2 * side)]

    if landmarks is not None:
        for x, y in pixels(landmarks):
            draw.ellipse([x - 2.4, y - 2.4, x + 2.4, y + 2.4], fill=_LANDMARK)
    origin = track.translations[index]
    tips = origin + _AXIS_LENGTH * track.rotations[index].T
    depth = [float((tip - origin) @ camera.w2c[2, :3].numpy().astype(np.float64)) for tip in tips]
    (start, *ends) = pixels(np.vstack([origin, tips]))
    for axis in np.argsort(depth)[::-1]:  # the nearest last
        draw.line([start, ends[axis]], fill=list(_AXES.values())[axis], width=5)
    return cell.resize((_CELL, _CELL), Image.Resampling.LANCZOS)


def _empty_cell(error: DynhairError) -> Image.Image:
    cell = Image.new("RGB", (_CELL, _CELL), (44, 30, 32))
    name = Path(error.path).name if error.path is not None else ""
    text = "\n".join([name, *(error.message[i : i + 32] for i in range(0, min(len(error.message), 192), 32))])
    ImageDraw.Draw(cell).multiline_text((10, 10), text, fill=_INK, font=_font(13), spacing=5)
    return cell


def _draw_header(sheet: Image.Image, capture: Capture, names: Sequence[str]) -> None:
    draw = ImageDraw.Draw(sheet)
    draw.text((12, 10), capture.name, fill=_INK, font=_font(20))
    x = 12 + draw.textlength(capture.name, font=_font(20)) + 20
    for letter, colour in _AXES.items():
        draw.text((x, 14), letter, fill=colour, font=_font(16))
        x += 16
    draw.text((x + 4, 14), "head axes, 8 cm", fill=_FAINT, font=_font(14))
    x += 4 + draw.textlength("head axes, 8 cm", font=_font(14)) + 20
    draw.ellipse([x, 20, x + 6, 26], fill=_LANDMARK)
    draw.text((x + 12, 14), "landmarks", fill=_FAINT, font=_font(14))
    for column, name in enumerate(names):
        left = _LABEL + column * (_CELL + _GAP)
        draw.text((left + _CELL / 2, _HEADER - 14), f"view {name}", fill=_FAINT, font=_font(14), anchor="mm")


def _draw_caption(cell: Image.Image, text: str) -> None:
    ImageDraw.Draw(cell).text((8, 6), text, fill=_INK, font=_font(13))


def _draw_label(sheet: Image.Image, top: int, title: str, size: str, kind: str, colour: tuple[int, int, int]) -> None:
    draw = ImageDraw.Draw(sheet)
    draw.rectangle([0, top, 4, top + _CELL - 1], fill=colour)
    draw.text((16, top + 10), title if len(title) <= 14 else title[:13] + "…", fill=_INK, font=_font(16))
    draw.text((16, top + 34), size, fill=_FAINT, font=_font(14))
    draw.text((16, top + 56), kind, fill=colour, font=_font(14))


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
