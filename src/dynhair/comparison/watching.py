"""What a row's log says of its progress, and the table that shows it."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from dynhair.comparison.record import Row

_TAIL = 8192  # bytes
_LINES_OF_ERROR, _LENGTH_OF_ERROR = 4, 800
_PROGRESS = re.compile(r"^(.+?): (\d+) of (\d+), (\d+) s, (\d+) s left, (.*)$")
_SPEED = re.compile(r"([\d.]+) it/s")


@dataclass(frozen=True)
class Step:
    """How far a row is in its present stage.

    Attributes:
        stage: what it does.
        done: steps.
        total: steps.
        speed: steps a second.
        left: seconds.
    """

    stage: str
    done: int
    total: int
    speed: float
    left: float


def last_step(log: Path, since: float = 0.0) -> Step | None:
    """What the newest progress line of a log says, and the time that has passed since taken off.

    Args:
        log: that :class:`~dynhair.progress.StageProgress` prints to.
        since: seconds since the epoch; what was logged before says nothing.
    """
    try:
        age = time.time() - log.stat().st_mtime
    except OSError:
        return None
    if time.time() - age < since:
        return None
    for line in reversed(_last_lines(log)):
        if match := _PROGRESS.match(line):
            stage, done, total, spent, left, note = match.groups()
            speed = _SPEED.search(note)
            rate = float(speed[1]) if speed else int(done) / max(int(spent), 1)
            return Step(stage, int(done), int(total), rate, max(float(left) - age, 0.0))
    return None


def last_words(log: Path) -> str:
    """The last lines of a log, in one: why it ended."""
    said = [line.strip() for line in _last_lines(log) if line.strip()]
    return " | ".join(said[-_LINES_OF_ERROR:])[-_LENGTH_OF_ERROR:]


def _last_lines(log: Path) -> list[str]:
    try:
        with log.open("rb") as file:
            file.seek(max(log.stat().st_size - _TAIL, 0))
            return file.read().decode("utf-8", errors="replace").splitlines()
    except OSError:
        return []


def progress_table(rows: Iterable[Row], running: Mapping[str, tuple[str, Step | None]]) -> Table:
    """A line for each row: what it does, how far it is, how fast, how long still.

    Args:
        rows: all of them.
        running: what those that run do, and how far they are in it, if that is known.
    """
    table = Table(box=None, pad_edge=False)
    table.add_column("row")
    table.add_column("state")
    for title in ("step", "it/s", "left"):
        table.add_column(title, justify="right")
    for row in rows:
        if row.name not in running:
            style = {"done": "green", "failed": "red"}.get(row.state, "dim")
            table.add_row(row.name, row.state if row.state != "pending" else "waiting", "", "", "", style=style)
            continue
        doing, step = running[row.name]
        if step is None:
            table.add_row(row.name, doing, "", "", "")
        else:
            speed = f"{step.speed:.1f}" if step.speed < 100 else f"{step.speed:.0f}"
            table.add_row(row.name, step.stage, f"{step.done}/{step.total}", speed, duration(step.left))
    return table


def result_table(rows: Iterable[Row]) -> Table:
    """A line for each row: how it ended, what it took."""
    table = Table(box=None, pad_edge=False)
    table.add_column("row")
    table.add_column("state")
    table.add_column("trained", justify="right")
    table.add_column("memory", justify="right")
    for row in rows:
        trained = "" if row.seconds_trained is None else duration(row.seconds_trained)
        memory = "" if row.peak_memory is None else f"{row.peak_memory / 1e9:.1f} GB"
        table.add_row(row.name, row.state, trained, memory)
    return table


def duration(seconds: float) -> str:
    """Hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}"
