"""Progress bars for long work: what is done, how fast, how long still."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


class StageProgress:
    """A bar for each stage. On a terminal it is redrawn; elsewhere a line is printed now and then.

    Args:
        console: where to print.
        lines: how many lines a stage prints where the output is not a terminal.
    """

    def __init__(self, console: Console, lines: int = 10) -> None:
        self._console = console
        self._lines = lines
        self._bars = Progress(
            TextColumn("{task.description:<28}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
            console=console,
            disable=not console.is_terminal,
        )

    @contextmanager
    def shown(self) -> Iterator[StageProgress]:
        """Show the bars for as long as the block runs."""
        with self._bars:
            yield self

    def stage(self, name: str, total: int, done: int = 0) -> Stage:
        """Begin a stage of ``total`` steps, of which ``done`` were done before."""
        task = self._bars.add_task(name, total=total, completed=done, note="")
        return Stage(self._bars, task, self._console, name, total, self._lines)


class Stage:
    """One stage's bar."""

    def __init__(self, bars: Progress, task: TaskID, console: Console, name: str, total: int, lines: int) -> None:
        self._bars, self._task, self._console = bars, task, console
        self._name, self._lines, self._total = name, lines, total
        self._first, self._began = int(bars.tasks[task].completed), time.monotonic()
        self._part = self._first * lines // max(total, 1)

    def update(self, done: int, note: str = "", total: int | None = None) -> None:
        """Say how many steps are done, with a short note; ``total`` corrects their number."""
        self._total = total or self._total
        self._bars.update(self._task, completed=done, total=self._total, note=note)
        part = done * self._lines // max(self._total, 1)
        if self._console.is_terminal or (part == self._part and done != self._total):
            return
        self._part = part
        elapsed = time.monotonic() - self._began
        left = elapsed / max(done - self._first, 1) * (self._total - done)
        self._console.print(
            f"{self._name}: {done} of {self._total}, {elapsed:.0f} s, {left:.0f} s left, {note}",
            highlight=False,
            soft_wrap=True,
        )
