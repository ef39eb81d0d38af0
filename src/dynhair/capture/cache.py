"""A thread-safe cache that forgets what was used longest ago once its contents exceed a number of bytes."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from threading import Lock
from typing import Generic, Protocol, TypeVar, runtime_checkable


@runtime_checkable
class _Sized(Protocol):
    @property
    def nbytes(self) -> int: ...


Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value", bound=_Sized)


class ByteCache(Generic[Key, Value]):
    """Keeps values while they fit.

    Args:
        budget: bytes that the values may take in all; a value larger than that is not kept.
    """

    def __init__(self, budget: int) -> None:
        self.budget = budget
        self.nbytes = 0
        self._values: OrderedDict[Key, Value] = OrderedDict()
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._values)

    def get(self, key: Key) -> Value | None:
        """Return the value kept under ``key``, now the most recently used; None if there is none."""
        with self._lock:
            value = self._values.get(key)
            if value is not None:
                self._values.move_to_end(key)
            return value

    def put(self, key: Key, value: Value) -> None:
        """Keep ``value``, forgetting as many of the others as it takes."""
        with self._lock:
            replaced = self._values.pop(key, None)
            self.nbytes -= replaced.nbytes if replaced is not None else 0
            if value.nbytes > self.budget:
                return
            self._values[key] = value
            self.nbytes += value.nbytes
            while self.nbytes > self.budget:
                _, oldest = self._values.popitem(last=False)
                self.nbytes -= oldest.nbytes
