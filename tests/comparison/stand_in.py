"""Rows of no time: a stand-in for the process that trains and measures one, and a comparison to put it in."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from dynhair.comparison.budget import MemoryEstimates
from dynhair.comparison.plan import ablated_rows, tasks
from dynhair.comparison.record import Comparison
from dynhair.comparison.schedule import Schedule
from dynhair.comparison.workers import Workers
from dynhair.presets import preset

_ROW = """
import json, os, pathlib, signal, sys, time
path, name = pathlib.Path(sys.argv[1]), sys.argv[2]
folder = path / ("shared" if name.startswith("hair") else ".") / name
orders = path / ".orders" / name
order = orders.read_text() if orders.exists() else ""
print("began", name, flush=True)
(folder / "begun").touch()
if order == "fail":
    print("the strands are on fire")
    sys.exit(2)
if order == "die":
    os.kill(os.getpid(), signal.SIGKILL)
if order == "wait":
    os.read(0, 1)
    (folder / "saved").touch()
    sys.exit(130)
if name.startswith("hair"):
    (folder / "canonical_hair.safetensors").write_text("hair of " + name)
    (folder / "first_guess.safetensors").write_text("guess of " + name)
    sys.exit()
(folder / "avatar").mkdir(exist_ok=True)
(folder / "avatar" / "avatar.json").write_text("{}")
if order != "unmeasured":
    (folder / "evaluation").mkdir(exist_ok=True)
    (folder / "evaluation" / "metrics.json").write_text("{}")
    for driver in json.loads((path / "comparison.json").read_text())["drivers"] if order != "undriven" else ():
        (folder / "driven_by" / driver).mkdir(parents=True, exist_ok=True)
        (folder / "driven_by" / driver / "metrics.json").write_text("{}")
"""


def stand_in(path: Path, name: str) -> Sequence[str]:
    """A command that makes a row's files, or does what it has been ordered to."""
    return (sys.executable, "-S", "-c", _ROW, str(path), name)


def order(path: Path, name: str, what: str) -> None:
    """Have a row fail, die, wait until it is stopped, leave out its evaluation or drivers, or, by "", do its work."""
    (path / ".orders").mkdir(parents=True, exist_ok=True)
    (path / ".orders" / name).write_text(what)


def comparison_of(path: Path, *ablations: str, seeds: Sequence[int] = (0,)) -> Comparison:
    """An ablation that has begun, of a capture that nobody opens."""
    rows = ablated_rows(ablations, seeds)
    comparison = Comparison(
        path, "ablations", path.parent / "capture", "tiny", preset("tiny"), {row.name: row for row in rows}
    )
    comparison.create()
    return comparison


def work(comparison: Comparison, jobs: int = 2, memory: int = 1000, *, terminal: bool = False) -> str:
    """Make all rows that are left, each of which takes 100 bytes until it is measured; what was said."""
    console = Console(file=io.StringIO(), width=200, force_terminal=terminal)
    estimates = MemoryEstimates(100)
    estimates.measure = lambda kind, memory: None  # real processes are larger than these budgets
    schedule = Schedule(tasks(comparison, comparison.rows), jobs, memory, estimates)
    schedule.observe = lambda name, memory: None
    Workers(comparison, schedule, estimates, 1, console, command=stand_in, tick=0.02).finish()
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def states(path: Path) -> dict[str, str]:
    """The state of each row of a comparison, as it is on disk."""
    return {name: row.state for name, row in Comparison.read(path).rows.items()}
