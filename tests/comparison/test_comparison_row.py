"""A row's own process: what it trains, what it measures, how it stops."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import dynhair.baselines
import dynhair.evaluation
import dynhair.training.trainer
from dynhair.comparison import row as row_module
from dynhair.comparison.plan import compared_rows
from dynhair.comparison.record import Comparison, Row
from dynhair.comparison.row import INTERRUPTED, main, make_row, tuning_minutes
from dynhair.comparison.rows import begin
from dynhair.errors import DynhairError
from dynhair.presets import preset


class Calls(list[tuple[str, dict[str, Any]]]):
    """What was called, in order."""

    def of(self, name: str, makes: str) -> Any:
        def call(*values: Any, **named: Any) -> None:
            self.append((name, {"values": values, **named}))
            target = values[2 if name == "evaluate" else 1 if name == "train" else 2]
            file = Path(target) / makes
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text("{}")

        return call


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    recorded = Calls()
    monkeypatch.setattr(dynhair.training.trainer, "train", recorded.of("train", "avatar/avatar.json"))
    monkeypatch.setattr(dynhair.baselines, "train_baseline", recorded.of("baseline", "avatar/avatar.json"))
    monkeypatch.setattr(dynhair.evaluation, "run_evaluation", recorded.of("evaluate", "metrics.json"))
    return recorded


@pytest.fixture
def compared(tmp_path: Path) -> Comparison:
    rows = compared_rows(["ours", "gha", "simulator", "simulator-tuned"], [5])
    comparison = Comparison(
        tmp_path / "out", "baselines", tmp_path / "capture", "tiny", preset("tiny"), {row.name: row for row in rows}
    )
    comparison.create()
    for row in rows:
        begin(comparison, row)
    return comparison


def test_a_row_is_trained_and_measured_once(compared: Comparison, calls: Calls) -> None:
    make_row(compared.path, "ours-seed5")
    make_row(compared.path, "ours-seed5")
    assert [name for name, _ in calls] == ["train", "evaluate"]
    trained, measured = (call for _, call in calls)
    assert trained["values"] == (compared.capture, compared.folder("ours-seed5"))
    assert trained["resume"] is True
    assert trained["stages"] == ("static", "dynamic")
    folder = compared.folder("ours-seed5")
    assert measured["values"] == (folder / "avatar", compared.capture, folder / "evaluation")


def test_each_driver_drives_a_row_once(compared: Comparison, calls: Calls, tmp_path: Path) -> None:
    make_row(compared.path, "ours-seed5")
    compared.drivers = {"first": tmp_path / "first", "second": tmp_path / "second"}
    compared.write()
    for _ in range(2):
        make_row(compared.path, "ours-seed5")
    folder = compared.folder("ours-seed5")
    assert [(*call["values"], call.get("reenact", False)) for name, call in calls if name == "evaluate"] == [
        (folder / "avatar", compared.capture, folder / "evaluation", False),
        (folder / "avatar", tmp_path / "first", folder / "driven_by" / "first", True),
        (folder / "avatar", tmp_path / "second", folder / "driven_by" / "second", True),
    ]


def test_shared_hair_is_made_and_not_measured(compared: Comparison, calls: Calls) -> None:
    make_row(compared.path, "hair-seed5")
    assert [(name, call["stages"]) for name, call in calls] == [("train", ("static",))]


def test_baselines_have_the_rows_settings_and_simulators_our_avatar(compared: Comparison, calls: Calls) -> None:
    compared.change("ours-seed5", seconds_trained=90.0)
    compared.write()
    for name in ("gha-seed5", "simulator-seed5", "simulator-tuned-seed5"):
        make_row(compared.path, name)
    gaussians, plain, tuned = (call for name, call in calls if name == "baseline")
    method, capture, out, config = gaussians["values"]
    assert (method, capture, out) == ("gha", compared.capture, compared.folder("gha-seed5"))
    assert config.training.seed == 5
    assert config.hair == compared.config.hair
    assert (gaussians["avatar"], gaussians["minutes"]) == (None, None)
    assert plain["values"][0] == tuned["values"][0] == "simulator"
    assert plain["avatar"] == tuned["avatar"] == compared.folder("ours-seed5") / "avatar"
    assert (plain["minutes"], tuned["minutes"]) == (None, 1.5)


def test_simulators_are_measured_on_held_out_motions_alone(compared: Comparison, calls: Calls) -> None:
    for name in ("ours-seed5", "gha-seed5", "simulator-seed5", "simulator-tuned-seed5"):
        make_row(compared.path, name)
    assert [call["training"] for name, call in calls if name == "evaluate"] == [True, True, False, False]


def test_simulators_are_tuned_for_an_hour_at_most() -> None:
    ours = Row("ours", "Ours", "ours", 0, "ours")
    assert tuning_minutes(dataclasses.replace(ours, seconds_trained=1e6)) == 60
    assert tuning_minutes(dataclasses.replace(ours, seconds_trained=None)) == 60


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (None, 0, ""),
        (KeyboardInterrupt(), INTERRUPTED, ""),
        (DynhairError("the disk is full", mend="free some space"), 2, "free some space"),
        (ZeroDivisionError("by zero"), 1, "Traceback"),
    ],
)
def test_the_exit_status_says_how_it_went(
    error: BaseException | None,
    status: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    def work(path: Path, name: str) -> None:
        if error is not None:
            raise error

    monkeypatch.setattr(row_module, "hold_leash", lambda: None)
    monkeypatch.setattr(row_module, "make_row", work)
    assert main("out", "row") == status
    printed = capfd.readouterr()
    assert said in printed.out + printed.err


def test_a_row_saves_once_its_standard_input_is_closed() -> None:
    code = (
        "import signal, sys, time\n"
        "from dynhair.comparison import row\n"
        "def work(path, name):\n"
        "    try: print('at work', flush=True); time.sleep(600)\n"
        "    except KeyboardInterrupt: print('saved', flush=True); raise\n"
        "row.make_row = work\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell's background jobs do\n"
        "sys.exit(row.main('out', 'row'))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "at work\n"
    out, _ = process.communicate(timeout=60)
    assert out == "saved\n"
    assert process.returncode == INTERRUPTED
