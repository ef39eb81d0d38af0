"""Shows an evaluation while it runs: a video of each test segment, and a contact sheet of all."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import numpy as np
from PIL import Image

from dynhair.capture import Capture, Segment
from dynhair.evaluation.face import frontality
from dynhair.evaluation.pictures import error_picture, fitted, picture
from dynhair.evaluation.records import EvaluatedFrame, ReenactedFrame
from dynhair.pictures import Picture, grid
from dynhair.storage import atomic_file
from dynhair.video import video_writer

SHEET_COLUMNS = 6
SHEET_WIDTH = 1920
"""Pixels; a contact sheet is scaled down to it."""


def most_frontal_view(capture: Capture, segment: Segment, index: int) -> int:
    """Index of the camera that looks the face most squarely in the eyes (head frame's +z) in one frame."""
    cameras = [capture.camera(segment.frames[index], name) for name in capture.camera_names]
    return int(np.argmax(frontality(capture, segment, index, cameras)))


class Recorder:
    """Observes an evaluation; a context manager, so that an error leaves no half-written video behind.

    Attributes:
        written: the files that are complete.

    Args:
        capture: what is evaluated against.
        out: folder of the videos and the contact sheet.
    """

    def __init__(self, capture: Capture, out: Path) -> None:
        self.written: list[Path] = []
        self._out = out
        self._fps = capture.fps
        self._view = most_frontal_view(capture, capture.segments[0], 0)
        self._video = ExitStack()
        self._append: Callable[[Picture], None] | None = None
        self._columns: list[tuple[str, list[Picture]]] = []
        tests = [
            (segment.name, index)
            for segment in capture.segments
            if segment.split == "test"
            for index in range(segment.count)
        ]
        count = min(SHEET_COLUMNS, len(tests))
        self._shown = {tests[(2 * column + 1) * len(tests) // (2 * count)] for column in range(count)}

    def __call__(self, frame: EvaluatedFrame) -> None:
        """Append a frame of a test segment to its video, and to the contact sheet if it is one of those shown."""
        segment = frame.segment
        if segment.split != "test":
            return
        truth, avatar = frame.truth[self._view], frame.avatar[self._view]
        shown = [picture(truth), picture(avatar), error_picture(avatar, truth)]
        path = self._out / f"test_{segment.name}.mp4"
        if self._append is None:
            self._append = self._video.enter_context(video_writer(path, self._fps))
        self._append(grid([shown], [""], ["truth", "avatar", "difference"]))
        if frame.index == segment.count - 1:
            self._video.close()
            self._append = None
            self.written.append(path)
        if (segment.name, frame.index) in self._shown:
            label = f"{segment.name} {frame.index / self._fps:.2f} s"
            rigid = [] if frame.rigid is None else [picture(frame.rigid[self._view])]
            self._columns.append((label, [*shown[:2], *rigid, shown[2]]))

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Discard an unfinished video; write the contact sheet if nothing went wrong."""
        self._video.__exit__(kind, error, traceback)
        if kind is None and self._columns:
            path = self._out / "contact_sheet.png"
            _write_sheet(path, self._columns)
            self.written.append(path)


class ReenactmentRecorder:
    """Observes a cross-reenactment: a video of each segment, the avatar beside its driver; a context manager.

    Attributes:
        written: the files that are complete.

    Args:
        driver: the other person's capture.
        out: folder of the videos.
    """

    def __init__(self, driver: Capture, out: Path) -> None:
        self.written: list[Path] = []
        self._fps, self._out = driver.fps, out
        self._video = ExitStack()
        self._append: Callable[[Picture], None] | None = None

    def __call__(self, frame: ReenactedFrame) -> None:
        """Append a frame to its segment's video."""
        path = self._out / f"cross_{frame.segment.name}.mp4"
        if self._append is None:
            self._append = self._video.enter_context(video_writer(path, self._fps))
        avatar = picture(frame.avatar)
        self._append(grid([[fitted(picture(frame.driver), avatar.shape[:2]), avatar]], [""], ["driver", "avatar"]))
        if frame.index == frame.segment.count - 1:
            self._video.close()
            self._append = None
            self.written.append(path)

    def __enter__(self) -> ReenactmentRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Discard an unfinished video."""
        self._video.__exit__(kind, error, traceback)


def _write_sheet(path: Path, columns: list[tuple[str, list[Picture]]]) -> None:
    rows = list(zip(*(cells for _, cells in columns), strict=True))
    rigid = ["rigid hair"] if len(rows) > 3 else []
    sheet = Image.fromarray(grid(rows, ["truth", "avatar", *rigid, "difference"], [label for label, _ in columns]))
    if sheet.width > SHEET_WIDTH:
        height = round(sheet.height * SHEET_WIDTH / sheet.width)
        sheet = sheet.resize((SHEET_WIDTH, height), Image.Resampling.LANCZOS)
    with atomic_file(path) as temporary:
        sheet.save(temporary, optimize=True)
