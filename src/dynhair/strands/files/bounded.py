"""Binary files whose counts are believed only as far as the file reaches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from dynhair.errors import DynhairError


def read_bytes(path: Path, what: str) -> bytes:
    """The whole file.

    Args:
        path: the file.
        what: which format is expected, for errors.

    Raises:
        DynhairError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise DynhairError(f"the file cannot be read ({error.strerror})", path=path, expected=what) from None


class Cursor:
    """Takes arrays off a file's content, from front to back.

    Args:
        content: of the file.
        path: the file, for errors.
        place: byte to start from.
    """

    def __init__(self, content: bytes, path: Path, place: int = 0) -> None:
        self._content, self._path, self._place = content, path, place

    def take(self, dtype: DTypeLike, *shape: int) -> np.ndarray:
        """The next numbers, as a read-only view of the content.

        Raises:
            DynhairError: the file ends before them, or a length is negative.
        """
        count, size = 1, np.dtype(dtype).itemsize
        for length in shape:
            if length < 0:
                raise DynhairError(f"it announces {length} numbers", path=self._path)
            count *= length
        left = (len(self._content) - self._place) // size
        if count > left:
            raise DynhairError(
                f"the file ends too early: {count} numbers are announced at byte {self._place} and {left} are there",
                path=self._path,
                mend="copy or download the file again: it seems to be cut off or damaged",
            )
        taken = np.frombuffer(self._content, dtype, count, self._place).reshape(shape)
        self._place += count * size
        return taken

    def end(self) -> None:
        """Refuse a file that goes on.

        Raises:
            DynhairError: there is more of it.
        """
        if self._place < len(self._content):
            raise DynhairError(
                f"the file goes on for {len(self._content) - self._place} bytes after its last strand",
                path=self._path,
                mend="copy or download the file again: its counts and its size do not agree",
            )
