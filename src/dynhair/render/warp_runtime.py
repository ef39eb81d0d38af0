"""NVIDIA Warp, started on first use and without its notices."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Iterator
from types import ModuleType


@functools.cache
def warp() -> ModuleType:
    """Import and initialise Warp: slow, so only what computes with it asks for it."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    with _silent_stderr():
        wp.init()
    return wp


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    """Hide what native code writes to stderr: Warp remarks there, past its log level, that there is no CUDA driver."""
    sys.stderr.flush()
    saved = os.dup(2)
    with open(os.devnull, "wb") as null:
        os.dup2(null.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
