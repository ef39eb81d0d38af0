"""Clips of the single methods, cut from the videos of their evaluations, and put side by side."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import av
import numpy as np
from av.error import FFmpegError
from PIL import Image

from dynhair.errors import DynhairError
from dynhair.pictures import Picture, grid
from dynhair.video import video_writer

WIDEST = 1600
"""Pixels: the widest video and contact sheet of a page."""

TRUTH_PANEL, METHOD_PANEL = 0, 1
"""Places in the videos of an evaluation."""


@dataclass(frozen=True)
class Clip:
    """One panel of an evaluation's video.

    Attributes:
        path: of the video.
        panel: from the left.
        aspect: width over height of one panel.
    """

    path: Path
    panel: int
    aspect: float

    def frames(self) -> Iterator[Picture]:
        """Cut the panel from each frame.

        Raises:
            DynhairError: the video cannot be read, or is laid out in another way.
        """
        try:
            with av.open(str(self.path)) as container:
                for frame in container.decode(container.streams.video[0]):
                    place = _panel(frame.width, frame.height, self.aspect, self.panel)
                    if place is None:
                        raise DynhairError(
                            f"its frames of {frame.width}x{frame.height} pixels hold no panel {self.panel + 1} "
                            f"of aspect {self.aspect:.3g}",
                            path=self.path,
                            expected="a row of panels as `dynhair evaluate` writes it",
                        )
                    top, left, height, width = place
                    yield frame.to_ndarray(format="rgb24")[top : top + height, left : left + width]
        except (FFmpegError, IndexError) as error:
            raise self._unreadable(f"not readable as a video ({error})") from None

    def some_frames(self, indices: Sequence[int]) -> list[Picture]:
        """Those of the frames, in their order.

        Raises:
            DynhairError: as for :meth:`frames`; or the video ends before the last of them.
        """
        found = [frame for index, frame in enumerate(self.frames()) if index in indices]
        if len(found) < len(indices):
            raise self._unreadable(f"the video ends before its frame {max(indices)}")
        return found

    def length(self) -> tuple[int, float]:
        """Number of frames, and frames per second, as the video's index has them.

        Raises:
            DynhairError: the video cannot be read.
        """
        try:
            with av.open(str(self.path)) as container:
                stream = container.streams.video[0]
                return stream.frames, float(stream.average_rate or 30)
        except (FFmpegError, IndexError) as error:
            raise self._unreadable(f"not readable as a video ({error})") from None

    def _unreadable(self, why: str) -> DynhairError:
        return DynhairError(why, path=self.path, mend="evaluate this row again")


@lru_cache
def _panel(width: int, height: int, aspect: float, panel: int) -> tuple[int, int, int, int] | None:
    """Top, left, height and width of a panel in a frame of a video; None if there is no such panel."""
    for rows in range(height, 0, -1):
        top, gap = _margins(rows)
        columns = round(aspect * rows)
        # an odd side was made even
        if top + rows + gap in (height, height - 1) and columns > 0:
            panels, rest = divmod(width - gap, columns + gap)
            if rest <= 1 and panel < panels:
                return top, gap + panel * (columns + gap), rows, columns
    return None


def write_clip(clip: Clip, out: Path) -> str:
    """Write one panel as a video of its own.

    Returns:
        A name for what is seen in it: that of its pixels, as encoders may write the same frames in other bytes.
    """
    seen = hashlib.sha256()
    with video_writer(out, clip.length()[1]) as append:
        for frame in clip.frames():
            append(frame)
            seen.update(frame.tobytes())
    return seen.hexdigest()[:12]


def write_side_by_side(clips: Sequence[Clip], labels: Sequence[str], out: Path) -> None:
    """Write clips of one length beside each other, labelled, for as long as all of them last.

    Args:
        clips: of one aspect; all take the size of the smallest.
        labels: above them.
        out: the video.
    """
    with ExitStack() as stack:
        append = stack.enter_context(video_writer(out, clips[0].length()[1]))
        for frames in zip(*(clip.frames() for clip in clips), strict=False):
            append(grid([_alike(frames)], [""], labels))


def contact_sheet(clips: Sequence[Clip], labels: Sequence[str], count: int) -> Picture:
    """Set the same ``count`` frames of each clip in rows, evenly spaced over the shortest clip.

    Raises:
        DynhairError: a video cannot be read, or has fewer frames than its index says.
    """
    length = min(clip.length()[0] for clip in clips)
    count = min(count, length)
    shown = [(2 * place + 1) * length // (2 * count) for place in range(count)]
    rows = [clip.some_frames(shown) for clip in clips]
    fps = clips[0].length()[1]
    cells = _alike([frame for row in rows for frame in row], WIDEST // max(count, 1))
    return grid(
        [cells[start : start + count] for start in range(0, len(cells), count)],
        labels,
        [f"{index / fps:.2f} s" for index in shown],
    )


def data_url(path: Path, kind: str) -> str:
    """Put a whole file into a URL."""
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def _margins(rows: int) -> tuple[int, int]:
    """Rows above and gap between the panels of `dynhair.pictures.grid`."""
    probe = grid([[np.zeros((rows, 1, 3), np.uint8)]], [""], [""])
    gap = max(2, rows // 64)
    return probe.shape[0] - rows - gap, gap


def _alike(frames: Sequence[Picture], widest: int | None = None) -> list[Picture]:
    """Bring frames to the size of the smallest, and to what a page is wide."""
    height, width = min((frame.shape[:2] for frame in frames), key=lambda size: size[1])
    limit = widest or WIDEST // len(frames)
    if width > limit:
        height, width = round(height * limit / width), limit
    return [
        frame
        if frame.shape[:2] == (height, width)
        else np.asarray(Image.fromarray(frame).resize((width, height), Image.Resampling.LANCZOS))
        for frame in frames
    ]
