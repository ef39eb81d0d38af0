"""Frames of any video with the times at which they are shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.video import opened_video, upright_pixels

if TYPE_CHECKING:
    import av
    from av.video.stream import VideoStream

_COPY_AGAIN = "copy it again, or convert it with ffmpeg"


@dataclass(frozen=True)
class TimedFrame:
    """One picture of a video.

    Attributes:
        time: when it is shown, seconds.
        pixels: sRGB, upright.
    """

    time: float
    pixels: UInt8[np.ndarray, "h w 3"]


def frame_count(path: Path) -> int:
    """About how many frames a video has, for progress bars; 0 where its header does not tell.

    Raises:
        DynhairError: it is no video.
    """
    with opened_video(path) as (container, stream):
        seconds = (container.duration or 0) * 1e-6
        return stream.frames or round(seconds * float(stream.average_rate or 0))


def timed_frames(path: Path, note: Callable[[str], None]) -> Iterator[TimedFrame]:
    """Decode a video once from front to back, at times that only grow.

    Damaged pictures are left out, as is what follows a place that cannot be decoded.

    Args:
        path: of the video.
        note: told where the video breaks off.

    Raises:
        DynhairError: it is no video, or nothing of it can be decoded.
    """
    from av.error import FFmpegError

    latest: float | None = None
    with opened_video(path) as (container, stream):
        stream.thread_type = "AUTO"
        try:
            for index, frame in enumerate(container.decode(stream)):
                time = _time(frame, index, stream)
                if not frame.is_corrupt and (latest is None or time > latest):
                    latest = time
                    yield TimedFrame(time, upright_pixels(frame))
        except FFmpegError as error:
            if latest is None:
                raise
            note(f"{path.name} is damaged ({error.strerror}): it is followed up to {latest:.1f} s")
    if latest is None:
        raise DynhairError("has no frames", path=path, expected="a video", mend=_COPY_AGAIN)


def _time(frame: av.VideoFrame, index: int, stream: VideoStream) -> float:
    if frame.time is not None:
        return float(frame.time)
    return index / float(stream.average_rate or 25)  # raw streams have no times
