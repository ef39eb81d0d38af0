"""Time by part: functions are watched from outside, and the backward of what they computed is told by hooks.

The time line is cut at marks: where a watched function is entered and left, and, in the backward, where the gradient
of one of its results is complete. Autograd goes backward in the reverse order of the forward, so what follows such a
mark is that function's backward, up to the next mark. Each moment counts for the innermost part alone.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import statistics
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch import Tensor


class Stopwatch:
    """Milliseconds by part and direction, and the bytes that the forward keeps for the backward.

    Attributes:
        rounds: for each round the milliseconds of each ``(part, direction)``.
        kept: bytes that each part keeps for the backward, each buffer counted for the part that kept it first.
    """

    def __init__(self) -> None:
        self.rounds: list[dict[tuple[str, str], float]] = []
        self.kept: dict[str, int] = defaultdict(int)
        self._times: dict[tuple[str, str], float] = defaultdict(float)
        self._now: tuple[str, str] | None = None
        self._since = 0.0
        self._thread = threading.get_ident()

    def switch(self, part: str, direction: str) -> tuple[str, str] | None:
        """What follows is the part's; returns whose the time was before. Other threads' calls change nothing."""
        if threading.get_ident() != self._thread:
            return None
        return self._mark((part, direction))

    def _mark(self, coming: tuple[str, str] | None) -> tuple[str, str] | None:
        moment, before = time.perf_counter(), self._now
        if before is not None:
            self._times[before] += 1e3 * (moment - self._since)
        self._now, self._since = coming, moment
        return before

    @contextlib.contextmanager
    def round(self) -> Iterator[None]:
        """One repetition of the work."""
        self._times = defaultdict(float)
        self._mark(None)
        yield
        self._mark(None)
        self.rounds.append(dict(self._times))

    @contextlib.contextmanager
    def part(self, name: str, direction: str = "forward") -> Iterator[None]:
        """A part of a round, inside of which others may lie."""
        before = self.switch(name, direction)
        yield
        if before is not None:
            self.switch(*before)

    def watch(self, owner: Any, name: str, part: str) -> None:
        """Count calls of ``owner.name`` and the backward of what they return for ``part``, from now on."""
        function: Callable[..., Any] = getattr(owner, name)

        @functools.wraps(function)
        def watched(*arguments: Any, **named: Any) -> Any:
            with self.part(part):
                result = function(*arguments, **named)
            for tensor in _differentiable(result):
                tensor.register_hook(lambda _: self.switch(part, "backward") and None)
            return result

        setattr(owner, name, watched)

    def watch_entry(self, owner: Any, name: str, part: str, direction: str) -> None:
        """Count what follows the calls of ``owner.name``, which only fetches what is about to be run, for ``part``."""
        function: Callable[..., Any] = getattr(owner, name)

        @functools.wraps(function)
        def watched(*arguments: Any, **named: Any) -> Any:
            self.switch(part, direction)
            return function(*arguments, **named)

        setattr(owner, name, watched)

    @contextlib.contextmanager
    def counting_memory(self, but: set[int]) -> Iterator[None]:
        """Add up what is kept for the backward, but for the storages at these addresses."""
        seen = set(but)

        def keep(tensor: Tensor) -> Tensor:
            storage = tensor.untyped_storage()
            if storage.data_ptr() not in seen and self._now is not None:
                seen.add(storage.data_ptr())
                self.kept[self._now[0]] += storage.nbytes()
            return tensor

        with torch.autograd.graph.saved_tensors_hooks(keep, lambda tensor: tensor):
            yield

    def medians(self) -> dict[tuple[str, str], float]:
        """Milliseconds of each part and direction, medians over the rounds."""
        keys = dict.fromkeys(key for times in self.rounds for key in times)
        return {key: statistics.median(times.get(key, 0.0) for times in self.rounds) for key in keys}


def _differentiable(result: Any) -> Iterator[Tensor]:
    """The tensors with a backward in what a function returned."""
    if isinstance(result, Tensor):
        if result.grad_fn is not None:
            yield result
    elif isinstance(result, (tuple, list)):
        for item in result:
            yield from _differentiable(item)
    elif dataclasses.is_dataclass(result):
        yield from _differentiable([getattr(result, field.name) for field in dataclasses.fields(result)])
