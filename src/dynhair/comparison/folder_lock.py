"""One command at a time in a folder."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from dynhair.errors import DynhairError

_PATIENCE = 20.0  # seconds, for rows that are still saving


@contextlib.contextmanager
def locked(path: Path, console: Console, patience: float = _PATIENCE) -> Iterator[int]:
    """Hold a folder's lock inside the block, making the folder if need be.

    The lock ends with the last process that has its file open: rows keep it while they outlive what started them.
    Where the system has no such locks, nothing is held.

    Args:
        path: the folder.
        console: where waiting is shown.
        patience: seconds to wait for it.

    Yields:
        The open file, to be kept open by the processes that work in the folder.

    Raises:
        DynhairError: another process holds it.
    """
    path.mkdir(parents=True, exist_ok=True)
    file = os.open(path / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
    try:
        with console.status("waiting for another process in this folder"):
            until = time.monotonic() + patience
            while not _taken(file):
                if time.monotonic() >= until:
                    raise DynhairError(
                        "another process is at work in this folder", path=path, mend="wait for its end, or stop it"
                    )
                time.sleep(0.2)
        yield file
    finally:
        os.close(file)


def _taken(file: int) -> bool:
    if sys.platform == "win32":
        return True
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
