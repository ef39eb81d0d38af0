"""Where an animation's frames go: a video, a folder of pictures, a preview."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.storage import atomic_file, read_json, write_json
from dynhair.video import video_writer

DESCRIPTION = "animation.json"
"""In a folder of pictures; says what they are of, so that an interrupted animation goes on with its own pictures."""

QUEUE = 4
"""Frames that wait for their encoding at most; more would only take memory."""

PREVIEW_SECONDS = 3.0

INVISIBLE = 0.5 / 255
"""Coverage that rounds to none."""


@runtime_checkable
class FrameOutput(Protocol):
    """Takes an animation's frames in order."""

    def needs(self, index: int) -> bool:
        """Whether a frame is still wanted."""
        ...

    def take(self, index: int, rgb: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"]) -> None:
        """Take a frame: colours over the background, in [0, 1], and their coverage."""
        ...


class Film:
    """A video of the frames over their background.

    Args:
        append: of a `video_writer`.
    """

    def __init__(self, append: Callable[[UInt8[np.ndarray, "_ _ 3"]], None]) -> None:
        self._append = append

    @classmethod
    @contextmanager
    def opened(cls, path: Path, fps: float) -> Iterator[Film]:
        """Begin a video, which appears when the block ends, and not at all on an error."""
        with video_writer(path, fps) as append:
            yield cls(append)

    def needs(self, index: int) -> bool:
        """A video is made anew from the first frame on."""
        return True

    def take(self, index: int, rgb: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"]) -> None:
        """Append a frame."""
        self._append(_in_bytes(rgb))


class PictureFolder:
    """PNG pictures without background: straight alpha, ``00000.png`` and so on. Those that are there are kept.

    Args:
        path: the folder.
        background: colour behind the frames, which is taken out of them.
        fingerprint: of all that the pictures depend on.

    Raises:
        DynhairError: the folder holds something else, or another animation.
    """

    def __init__(self, path: Path, background: Float[Tensor, "3"], fingerprint: str) -> None:
        self._path, self._background = path, background.cpu()
        described = path / DESCRIPTION
        mend = "choose another folder, or remove this one"
        if described.exists():
            if read_json(described).get("fingerprint") != fingerprint:
                raise DynhairError("the folder holds another animation", path=path, mend=mend)
        elif path.is_file() or (path.is_dir() and any(path.iterdir())):
            raise DynhairError("there is something else", path=path, expected="an empty or a new folder", mend=mend)
        else:
            write_json(described, {"kind": "dynhair animation", "version": 1, "fingerprint": fingerprint})

    def needs(self, index: int) -> bool:
        """Whether there is no such picture yet."""
        return not self._file(index).exists()

    def take(self, index: int, rgb: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"]) -> None:
        """Write a picture."""
        if self.needs(index):
            with atomic_file(self._file(index)) as temporary:
                Image.fromarray(straight_alpha(rgb, alpha, self._background)).save(temporary, compress_level=6)

    def _file(self, index: int) -> Path:
        return self._path / f"{index:05d}.png"


class Preview:
    """The newest frame as a picture that is replaced now and then, while the animation is being made.

    Args:
        path: of the picture.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._last = path, -PREVIEW_SECONDS

    @classmethod
    @contextmanager
    def shown(cls, path: Path) -> Iterator[Preview]:
        """A preview that goes when the block ends."""
        try:
            yield cls(path)
        finally:
            path.unlink(missing_ok=True)

    def needs(self, index: int) -> bool:
        """A preview asks for no frame that nobody else needs."""
        return False

    def take(self, index: int, rgb: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"]) -> None:
        """Show a frame, if the last one is some seconds old."""
        if time.monotonic() - self._last < PREVIEW_SECONDS:
            return
        with atomic_file(self._path) as temporary:
            Image.fromarray(_in_bytes(rgb)).save(temporary)
        self._last = time.monotonic()


class Beside:
    """Gives frames to an output in a thread of its own, beside the drawing of the next ones.

    Args:
        output: that takes them.
        thread: one worker, which keeps their order.
    """

    def __init__(self, output: FrameOutput, thread: ThreadPoolExecutor) -> None:
        self._output, self._thread = output, thread
        self._waiting: deque[Future[None]] = deque()

    @classmethod
    @contextmanager
    def drawing(cls, output: FrameOutput) -> Iterator[Beside]:
        """Take frames until the block ends; then wait for the last ones.

        Raises:
            DynhairError: as the output does, a few frames late.
        """
        with ThreadPoolExecutor(1) as thread:
            beside = cls(output, thread)
            try:
                yield beside
            except BaseException:
                thread.shutdown(cancel_futures=True)
                raise
            beside._wait(0)

    def needs(self, index: int) -> bool:
        """Whether the output still wants a frame."""
        return self._output.needs(index)

    def take(self, index: int, rgb: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"]) -> None:
        """Hand a frame over; wait while too many are under way."""
        self._waiting.append(self._thread.submit(self._output.take, index, rgb, alpha))
        self._wait(QUEUE)

    def _wait(self, most: int) -> None:
        while len(self._waiting) > most:
            self._waiting.popleft().result()


def straight_alpha(
    rgb: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"], background: Float[Tensor, "3"]
) -> UInt8[np.ndarray, "h w 4"]:
    """Take the background out of colours that stand over it: ``c = (rgb - (1 - alpha) background) / alpha``.

    Where nothing is covered the colour is black.
    """
    coverage = alpha[..., None].clamp(0.0, 1.0)
    own = (rgb - (1 - coverage) * background) / coverage.clamp_min(INVISIBLE)
    return _in_bytes(torch.cat([own * (coverage > INVISIBLE), coverage], -1))


def _in_bytes(image: Float[Tensor, "h w c"]) -> UInt8[np.ndarray, "h w c"]:
    return (image.clamp(0.0, 1.0) * 255.0).round().byte().numpy()
