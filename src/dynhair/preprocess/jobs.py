"""What is still to be done: jobs whose outputs are missing or older than their inputs, and doing them on all cores.

The rule is that of make: an output is fresh when it is there and nothing that it was made from is newer. A step's
settings are a file too, which is written anew only when they change, so that other settings make its outputs stale. A
mask mended by hand is newer than its inputs and stays; what is made from it is made again.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from dynhair.errors import DynhairError
from dynhair.storage import read_json, write_json
from dynhair.threads import thread_count

T = TypeVar("T")


@dataclass(frozen=True)
class Job(Generic[T]):
    """One piece of a step's work.

    Attributes:
        what: is done, for instance a view.
        inputs: files that it reads.
        outputs: files that it writes, each atomically.
    """

    what: T
    inputs: tuple[Path, ...]
    outputs: tuple[Path, ...]

    def is_fresh(self, record: Path) -> bool:
        """Whether all outputs are there and none is older than an input or than the settings."""
        return is_fresh(self.outputs, (*self.inputs, record))


def is_fresh(outputs: Iterable[Path], inputs: Iterable[Path]) -> bool:
    """Whether all outputs are there and none is older than an input; an input that is missing is not newer."""
    written = [_modified(path) for path in outputs]
    if any(time is None for time in written):
        return False
    oldest = min((time for time in written if time is not None), default=0)
    return all((time := _modified(path)) is None or time <= oldest for path in inputs)


def record_settings(path: Path, settings: Mapping[str, Any]) -> bool:
    """Keep a step's settings in a JSON file, which is left untouched where it says the same.

    Returns:
        Whether they are new.
    """
    if path.exists():
        try:
            if read_json(path) == settings:
                return False
        except DynhairError:
            pass  # cut short by a full disk, say: as good as missing
    write_json(path, settings)
    return True


def for_each(items: Sequence[T], make_worker: Callable[[], Callable[[T], None]], done: Callable[[int], None]) -> None:
    """Do something for each item, on as many threads as there are cores.

    Args:
        items: what is to be done.
        make_worker: called once in each thread, as networks are not shared between threads.
        done: called with the number of items done so far.

    Raises:
        Exception: the first that a worker raised; items not yet begun are left undone, as on Ctrl-C.
    """
    if len(items) == 1:  # here, where Ctrl-C stops it at once: it may take minutes
        make_worker()(items[0])
        done(1)
        return
    mine = threading.local()

    def work(item: T) -> None:
        if not hasattr(mine, "worker"):
            mine.worker = make_worker()
        mine.worker(item)

    with ThreadPoolExecutor(min(thread_count(), len(items)) or 1) as pool:
        futures = [pool.submit(work, item) for item in items]
        try:
            for count, future in enumerate(as_completed(futures), 1):
                future.result()
                done(count)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _modified(path: Path) -> int | None:
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:
        return None
