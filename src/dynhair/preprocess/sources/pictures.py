"""Frames stored as single image files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from dynhair.capture.encoding import read_rgb, read_size
from dynhair.errors import DynhairError
from dynhair.preprocess.sources.recording import Frames

EXTENSIONS = (".png", ".jpg", ".jpeg")


@dataclass(frozen=True)
class PictureFrames(Frames):
    """One image file for each frame.

    Attributes:
        path: their folder.
        files: in order of time, at least one.
    """

    files: tuple[Path, ...]

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.files)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the first."""
        return self._size

    @cached_property
    def _size(self) -> tuple[int, int]:
        return read_size(self.files[0])

    @property
    def fps(self) -> float | None:
        """None: image files do not say it."""
        return None

    def read(
        self, indices: Iterable[int], note: Callable[[str], None]
    ) -> Iterator[tuple[int, UInt8[np.ndarray, "h w 3"]]]:
        """Yield pictures by ascending index.

        Raises:
            DynhairError: one is missing, damaged, or of another size than the first.
        """
        for index in sorted(set(indices)):
            pixels = read_rgb(self.files[index])
            if pixels.shape[1::-1] != self.size:
                raise DynhairError(
                    f"is {pixels.shape[1]} x {pixels.shape[0]} pixels",
                    path=self.files[index],
                    expected=f"{self.size[0]} x {self.size[1]}, as the first of its camera",
                )
            yield index, pixels


def picture_files(folder: Path) -> list[Path]:
    """List the image files in a folder, ``2`` before ``10``."""
    files = [entry for entry in folder.iterdir() if entry.suffix.lower() in EXTENSIONS and entry.is_file()]
    return sorted(files, key=natural_key)


def natural_key(path: Path) -> list[tuple[int, str]]:
    """Sort key that compares runs of digits as numbers."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def frame_numbers(files: Sequence[Path]) -> list[int] | None:
    """Read the number at the end of each file's name; None unless all have one.

    Raises:
        DynhairError: the numbers leave a gap: an image is missing.
    """
    matches = [re.search(r"(\d+)$", file.stem) for file in files]
    found = [int(match[1]) for match in matches if match]
    if len(found) < len(files):
        return None
    steps = [after - before for before, after in pairwise(found)]
    for i, step in enumerate(steps):
        if step != min(steps):
            raise DynhairError(
                f"the image after {files[i].name} is missing: the next is {files[i + 1].name}",
                path=files[i].parent,
                expected="consecutive numbers",
                mend="add the image, or make the rest another take",
            )
    return found
