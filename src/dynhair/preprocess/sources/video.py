"""Videos, decoded once from front to back, one frame in memory at a time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.recording import Frames

if TYPE_CHECKING:
    import av
    from av.container import InputContainer
    from av.video.stream import VideoStream

EXTENSIONS = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm")
_CODEC_THREADS = max(1, min(4, (os.cpu_count() or 1) // 4))  # several videos are decoded side by side
_UNEVEN = 1.5  # times the usual time between frames: a frame was dropped


@dataclass(frozen=True)
class VideoFrames(Frames):
    """The frames of a video file, turned upright if the file says how.

    Attributes:
        path: the file.
    """

    @property
    def count(self) -> int:
        """How many frames the file holds, as its index says."""
        return self._header[0]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the upright picture."""
        return self._header[1]

    @property
    def fps(self) -> float:
        """The average rate."""
        return self._header[2]

    @cached_property
    def _header(self) -> tuple[int, tuple[int, int], float]:
        with opened_video(self.path) as (container, stream):
            rate = stream.average_rate or stream.guessed_rate
            if not rate:
                raise DynhairError("does not say its frame rate", path=self.path, mend="give fps, or convert it")
            count = stream.frames or sum(packet.size > 0 for packet in container.demux(stream))
            container.seek(0)
            height, width = upright_pixels(next(container.decode(stream))).shape[:2]
            return count, (width, height), float(rate)

    def read(
        self, indices: Iterable[int], note: Callable[[str], None]
    ) -> Iterator[tuple[int, UInt8[np.ndarray, "h w 3"]]]:
        """Yield frames by ascending index in one pass.

        Frames are counted, not sought by their time, so that the same index is the same frame in every video.

        Raises:
            DynhairError: the file is damaged, or ends before the last of them.
        """
        wanted = iter(sorted(set(indices)))
        next_wanted = next(wanted, None)
        if next_wanted is None:
            return
        times: list[int] = []
        index = -1
        with opened_video(self.path) as (container, stream):
            stream.codec_context.thread_count = _CODEC_THREADS
            for index, frame in enumerate(container.decode(stream)):
                if frame.pts is not None:
                    times.append(frame.pts)
                if index == next_wanted:
                    if frame.is_corrupt:
                        note(f"{self.path}: frame {index} is damaged")
                    yield index, upright_pixels(frame)
                    next_wanted = next(wanted, None)
                    if next_wanted is None:
                        self._note_uneven(np.diff(times), note)
                        return
        raise DynhairError(
            f"ends after {index + 1} frames, though its index says {self.count}",
            path=self.path,
            expected=f"frame {next_wanted}",
            mend=f"give a stop of {index + 1}, or copy the file again",
        )

    def _note_uneven(self, steps: np.ndarray, note: Callable[[str], None]) -> None:
        uneven = np.flatnonzero(steps > _UNEVEN * np.median(steps)) if len(steps) else steps
        if len(uneven):
            note(
                f"{self.path}: frames are not evenly spaced in time ({len(uneven)} of {len(steps)} steps are too long, "
                f"the first after frame {uneven[0]}); they are taken as if they were"
            )


@contextmanager
def opened_video(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """Open a video; what fails inside the block for its damage is a DynhairError.

    Raises:
        DynhairError: the file is missing, has no video stream, or cannot be decoded.
    """
    import av
    from av.error import FFmpegError

    if not path.is_file():
        raise DynhairError("the video is missing", path=path)
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise DynhairError("has no video stream", path=path, expected="a video")
            yield container, container.streams.video[0]
    except (FFmpegError, StopIteration) as error:
        reason = error.strerror if isinstance(error, FFmpegError) else "it has no frames"
        raise DynhairError(
            f"cannot be decoded ({reason})", path=path, expected="a whole video", mend="copy it again"
        ) from None


def upright_pixels(frame: av.VideoFrame) -> UInt8[np.ndarray, "h w 3"]:
    """A frame's sRGB, turned as the file says."""
    pixels = frame.to_ndarray(format="rgb24")
    turns = round(frame.rotation / 90) % 4  # phones store portraits lying down
    return np.ascontiguousarray(np.rot90(pixels, turns)) if turns else pixels
