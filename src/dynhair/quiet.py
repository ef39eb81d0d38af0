"""Silence for what native libraries remark on stderr, past any log level."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator

_ONE_AT_A_TIME = threading.Lock()


@contextlib.contextmanager
def silent_stderr() -> Iterator[None]:
    """Hide what native code writes to stderr inside the block."""
    with _ONE_AT_A_TIME:  # stderr is the process's: two threads would restore each other's silence
        sys.stderr.flush()
        saved = os.dup(2)
        with open(os.devnull, "wb") as null:
            os.dup2(null.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
