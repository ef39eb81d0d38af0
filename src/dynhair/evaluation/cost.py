"""What an evaluation costs: wall time, by part."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Cost:
    """Time of an evaluation.

    Attributes:
        frames: evaluated.
        views: of each.
        seconds: wall time in all.
        parts: of it, seconds by name: ``drawing`` (posing and rendering, the rigid twin's included), ``networks``,
            ``figures`` (all others), ``pictures`` (videos and sheets) and ``reading`` (waiting for the truth's images).
    """

    frames: int
    views: int
    seconds: float
    parts: dict[str, float]

    def to_json(self) -> dict[str, Any]:
        """Lay it out, with the time of 100 frames seen by one camera."""
        images = self.frames * self.views
        return {
            "frames": self.frames,
            "views": self.views,
            "seconds": self.seconds,
            "seconds_per_100_frames_and_view": 100.0 * self.seconds / images if images else None,
            "parts": self.parts,
        }


class Stopwatch:
    """Adds up the time spent in named parts; of parts within each other, the innermost counts."""

    def __init__(self) -> None:
        self._parts: defaultdict[str, float] = defaultdict(float)
        self._running: list[str] = []
        self._begun = self._last = time.perf_counter()

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Count the time inside as this part's."""
        self._count()
        self._running.append(name)
        try:
            yield
        finally:
            self._count()
            self._running.pop()

    def cost(self, frames: int, views: int) -> Cost:
        """Sum up; time in no part was spent reading."""
        self._count()
        return Cost(frames, views, self._last - self._begun, dict(self._parts))

    def _count(self) -> None:
        now = time.perf_counter()
        self._parts[self._running[-1] if self._running else "reading"] += now - self._last
        self._last = now
