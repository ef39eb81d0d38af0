"""Progress where the output is not a terminal."""

from __future__ import annotations

import io

from rich.console import Console

from dynhair.progress import StageProgress


def test_a_stage_prints_a_few_lines_with_the_time_left() -> None:
    out = io.StringIO()
    with StageProgress(Console(file=out), lines=4).shown() as progress:
        stage = progress.stage("reading", 1)
        for step in range(1, 41):
            stage.update(step, f"loss {step}", total=40)
    lines = out.getvalue().splitlines()
    assert [line.split(",")[0] for line in lines] == [f"reading: {step} of 40" for step in (10, 20, 30, 40)]
    assert lines[-1].endswith("0 s left, loss 40")


def test_a_resumed_stage_goes_on_counting() -> None:
    out = io.StringIO()
    with StageProgress(Console(file=out), lines=2).shown() as progress:
        stage = progress.stage("training", 10, done=6)
        for step in range(7, 11):
            stage.update(step)
    assert [line.split(",")[0] for line in out.getvalue().splitlines()] == ["training: 10 of 10"]


def test_uneven_steps_are_told_as_often() -> None:
    out = io.StringIO()
    with StageProgress(Console(file=out), lines=5).shown() as progress:
        stage = progress.stage("learning", 97)
        for step in range(12, 97, 12):
            stage.update(step)
        stage.update(97)
    assert len(out.getvalue().splitlines()) == 5
