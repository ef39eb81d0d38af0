"""How much memory there is, how much a row takes, and how much it is expected to take."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path

from dynhair.config import Config

_SHARE = 0.8
_HEADROOM = 1.1  # rows of one kind differ by this much at most
_PROGRAM = 1.8e9  # bytes; 1 GiB of it are decoded images
_GAUSSIAN = 9e3  # bytes, with all that its gradients, its share in the networks and its pixels take
_PROC = Path("/proc")
_CGROUP = Path("/sys/fs/cgroup")


def memory_budget(gigabytes: float | None) -> int:
    """Bytes that rows may take together: what is asked for, or 80 % of what is free."""
    return int(available_memory() * _SHARE) if gigabytes is None else int(gigabytes * 1e9)


def available_memory() -> int:
    """Bytes of memory that programs may still take, in the machine and in the container around them."""
    free = _machine_memory()
    with contextlib.suppress(OSError, ValueError):  # no container, or one without a limit
        limit, taken = (int((_CGROUP / f"memory.{name}").read_text()) for name in ("max", "current"))
        details = dict(line.split() for line in (_CGROUP / "memory.stat").read_text().splitlines())
        free = min(free, limit - taken + int(details.get("inactive_file", 0)))  # files kept in memory give way
    return max(free, 0)


def _machine_memory() -> int:
    with contextlib.suppress(OSError):
        for line in (_PROC / "meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def peak_memory(process: int) -> int | None:
    """Bytes of memory that a running process has taken at most; None where the system does not say."""
    with contextlib.suppress(OSError):
        for line in (_PROC / str(process) / "status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return None


def stated_memory(config: Config) -> int:
    """Bytes that a row should suffice with, from the sizes in its configuration: a guess on the safe side.

    It is 2 GB for preset ``tiny``, which takes 0.7 GB beside the kept images, and 7 GB for ``paper``, which takes 6.4.
    """
    hair, head = config.hair, config.head
    return int(_PROGRAM + _GAUSSIAN * (hair.strands * (hair.points - 1) + head.gaussians + head.mouth_gaussians))


class MemoryEstimates:
    """What rows are expected to take: the most that one of their kind has taken, or the stated guess until one has.

    Args:
        stated: the guess for any kind.
        measured: what rows took before, by kind.
    """

    def __init__(self, stated: int, measured: Mapping[str, int] | None = None) -> None:
        self.stated = stated
        self._measured = dict(measured or {})

    def measure(self, kind: str, memory: int) -> None:
        """Tell what a row took from its beginning to its end."""
        self._measured[kind] = max(self._measured.get(kind, 0), memory)

    def __call__(self, kind: str) -> int:
        """Bytes that a row of a kind is expected to take."""
        measured = self._measured.get(kind)
        return self.stated if measured is None else int(_HEADROOM * measured)
