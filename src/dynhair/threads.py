"""Work on several threads.

PyTorch's own threads (OpenMP) share every single operation, and must be woken for each: with the many short operations
of a training step that costs more than it brings. On a 2-core machine a step took 1.3 times as long on two such threads
as on one. Threads that each take a large piece of work are woken a few times a step.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch
from threadpoolctl import threadpool_limits

T = TypeVar("T")

_own: int | None = None


def thread_count() -> int:
    """How many threads :func:`run` uses: as many as PyTorch may, or may when it is not held to one."""
    return _own or torch.get_num_threads()


@contextlib.contextmanager
def large_pieces() -> Iterator[None]:
    """Hold PyTorch and NumPy's BLAS to one thread inside the block; :func:`run` uses as many as PyTorch had."""
    global _own  # noqa: PLW0603 (PyTorch's number of threads is global as well)
    before, _own = _own, thread_count()
    held = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(held)
        _own = before


def run(tasks: Iterable[Callable[[], None]]) -> None:
    """Run tasks side by side; an error in one is raised when all are done."""
    tasks = list(tasks)
    workers = min(thread_count(), len(tasks))
    if workers <= 1:
        for task in tasks:
            task()
        return
    with ThreadPoolExecutor(workers) as pool:  # not kept: its threads would not survive a fork
        for done in [pool.submit(task) for task in tasks]:
            done.result()


def beside(work: Callable[[], T]) -> Callable[[], T]:
    """Begin work in a thread of its own, which :func:`thread_count` does not count.

    Returns:
        What waits for the work and returns its result, or raises its error.
    """
    pool = ThreadPoolExecutor(1)
    result = pool.submit(work).result
    pool.shutdown(wait=False)  # its thread ends with the work
    return result


def shares(count: int) -> list[tuple[int, int]]:
    """Contiguous ranges of ``range(count)``, one for each thread that :func:`run` would use."""
    parts = max(min(thread_count(), count), 1)
    return [(count * part // parts, count * (part + 1) // parts) for part in range(parts)]


def keep_large_blocks() -> None:
    """Ask glibc to reuse large blocks of memory instead of mapping fresh pages for each tensor.

    A training step allocates the same tensors over and over: with fresh pages, a sixth of its time went into faults.
    Does nothing where there is no glibc.
    """
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL("libc.so.6").mallopt
        trim_threshold, mmap_threshold = -1, -3  # glibc's names for these, from malloc.h
        mallopt(mmap_threshold, 1 << 30)
        mallopt(trim_threshold, 1 << 30)
