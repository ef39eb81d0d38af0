"""Memory that one rendering after the other uses: fresh pages from the system cost more than some of the kernels."""

from __future__ import annotations

import math
import queue
import threading
import weakref

import torch
from torch import Tensor

SMALLEST = 1 << 20  # bytes; below this the allocator itself keeps memory
KEPT = 1 << 29  # bytes kept while nobody uses them


class Workspace:
    """Lends buffers; what was lent comes back when the workspace is collected."""

    def __init__(self) -> None:
        self._lent: list[Tensor] = []
        weakref.finalize(self, _returned.put, self._lent).atexit = False

    def empty(self, *shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
        """A tensor like ``torch.empty``, valid as long as the workspace lives."""
        size = math.prod(shape) * dtype.itemsize
        if size < SMALLEST:
            return torch.empty(shape, dtype=dtype)
        step = 1 << (size.bit_length() - 4)  # sizes in steps of an eighth, so that a little more or less still fits
        buffer = _take(-(-size // step) * step)
        self._lent.append(buffer)
        return buffer[:size].view(dtype).view(shape)

    def zeros(self, *shape: int) -> Tensor:
        """A tensor like ``torch.zeros``, valid as long as the workspace lives."""
        return self.empty(*shape).zero_()


_returned: queue.SimpleQueue[list[Tensor]] = queue.SimpleQueue()  # may be put to from a finalizer, whoever holds a lock
_free: list[Tensor] = []  # the most recently used last
_lock = threading.Lock()


def _take(size: int) -> Tensor:
    """A buffer of ``size`` bytes: one that came back if there is one."""
    with _lock:
        while True:
            try:
                _free.extend(_returned.get_nowait())
            except queue.Empty:
                break
        for index in reversed(range(len(_free))):
            if len(_free[index]) == size:
                return _free.pop(index)
        surplus = sum(len(buffer) for buffer in _free) - KEPT
        while surplus > 0:
            surplus -= len(_free.pop(0))
    return torch.empty(size, dtype=torch.uint8)
