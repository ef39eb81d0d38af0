"""What logs say of progress and of failures, and the tables made of it."""

from __future__ import annotations

import io
import os
import time
from pathlib import Path

from rich.console import Console

from dynhair.comparison.record import Row
from dynhair.comparison.watching import Step, duration, last_step, last_words, progress_table, result_table
from dynhair.progress import StageProgress


def logged(path: Path, *, note: str) -> Path:
    """A log of a stage that is half done, with other words after it."""
    with path.open("w") as file:
        console = Console(file=file, width=60)
        console.print("No orientation maps: strands follow the silhouettes alone.")
        with StageProgress(console).shown() as progress:
            stage = progress.stage("hair and head together", 40)
            for done in range(1, 21):
                stage.update(done, note)
        console.print("a view is damaged; training goes on")
    return path


def test_a_stages_own_lines_are_understood(tmp_path: Path) -> None:
    step = last_step(logged(tmp_path / "log", note="loss 0.1, 12.5 it/s, 3 skipped"))
    assert step is not None
    assert (step.stage, step.done, step.total, step.speed) == ("hair and head together", 20, 40, 12.5)
    step = last_step(logged(tmp_path / "log", note="loss 0.1"))
    assert step is not None
    assert step.speed == 20


def test_time_passes_between_the_lines(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_text("mesh head: 10 of 40, 100 s, 300 s left, loss 1\n")
    age = time.time() - 120
    os.utime(log, (age, age))
    step = last_step(log)
    assert step is not None
    assert step.speed == 0.1
    assert 178 < step.left < 181
    os.utime(log, (age - 1000, age - 1000))
    step = last_step(log)
    assert step is not None
    assert step.left == 0


def test_what_an_earlier_process_said_is_no_progress(tmp_path: Path) -> None:
    log = logged(tmp_path / "log", note="loss 1")
    assert last_step(log, since=time.time() + 60) is None
    assert last_step(tmp_path / "none") is None
    log.write_text("nothing of the kind\n")
    assert last_step(log) is None


def test_the_last_words_of_a_long_log_are_few(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_bytes(b"\xff" * 10_000 + b"\n" + "\n\n".join(f"line {n}" for n in range(5000)).encode())
    assert last_words(log) == "line 4996 | line 4997 | line 4998 | line 4999"
    assert last_words(tmp_path / "none") == ""


def test_tables_have_a_line_for_each_row() -> None:
    rows = [
        Row("full-seed0", "Ours", "ours", 0, "full-seed0", 3725.0, "done", peak_memory=2_340_000_000),
        Row("pose-seed0", "w/ pose", "pose", 0, "pose-seed0"),
        Row("rigid-seed0", "Rigid", "rigid", 0, "rigid-seed0"),
        Row("one-view-seed0", "1 view", "one-view", 0, "one-view-seed0", state="failed", error="on fire"),
    ]
    console = Console(file=io.StringIO(), width=120)
    console.print(progress_table(rows, {"pose-seed0": ("training", Step("together", 20, 40, 12.5, 61.0))}))
    console.print(result_table(rows))
    assert isinstance(console.file, io.StringIO)
    lines = [line.split() for line in console.file.getvalue().splitlines()]
    assert lines[1] == ["full-seed0", "done"]
    assert lines[2] == ["pose-seed0", "together", "20/40", "12.5", "0:01:01"]
    assert lines[3] == ["rigid-seed0", "waiting"]
    assert lines[4] == ["one-view-seed0", "failed"]
    assert lines[6] == ["full-seed0", "done", "1:02:05", "2.3", "GB"]


def test_durations_have_hours() -> None:
    assert [duration(seconds) for seconds in (0.4, 59.6, 3600.0, 90_061.0)] == [
        "0:00:00",
        "0:01:00",
        "1:00:00",
        "25:01:01",
    ]
