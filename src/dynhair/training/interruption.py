"""Stopping on Ctrl-C between two steps, never inside one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interruption:
    """Whether Ctrl-C was pressed.

    Attributes:
        requested: set by the first Ctrl-C; a second one interrupts at once.
    """

    requested: bool = False


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Turn the first Ctrl-C inside the block into a request, so that the state can be saved whole.

    Signals belong to the main thread: in any other one the request never comes.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    before = signal.getsignal(signal.SIGINT)

    def request(_signal: int, _frame: FrameType | None) -> None:
        interruption.requested = True
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, request)
    try:
        yield interruption
    finally:
        signal.signal(signal.SIGINT, before)
