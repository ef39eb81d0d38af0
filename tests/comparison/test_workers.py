"""Rows in processes of their own: what is left when they fail, are killed, or are stopped."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest
from stand_in import comparison_of, order, states, work

from dynhair.comparison.record import Comparison


def test_all_rows_are_made_and_share_their_hair(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity", "rigid", seeds=[0, 1])
    work(comparison)
    assert set(states(comparison.path).values()) == {"done"}
    for name in ("full-seed1", "no-gravity-seed1", "rigid-seed1"):
        folder = comparison.folder(name)
        assert (folder / "canonical_hair.safetensors").read_text() == "hair of hair-seed1"
        assert (folder / "first_guess.safetensors").exists()
        assert f"began {name}" in (folder / "train.log").read_text()
    seconds = Comparison.read(comparison.path).rows["no-gravity-seed0"].seconds_trained
    assert seconds is not None
    assert 0 <= seconds < 60


def test_a_row_that_fails_keeps_no_other_back_and_is_tried_again(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity", "rigid")
    order(comparison.path, "no-gravity-seed0", "fail")
    said = work(comparison)
    assert states(comparison.path) == {
        "hair-seed0": "done",
        "full-seed0": "done",
        "no-gravity-seed0": "failed",
        "rigid-seed0": "done",
    }
    error = Comparison.read(comparison.path).rows["no-gravity-seed0"].error
    assert error is not None
    assert "exit status 2" in error
    assert "the strands are on fire" in error
    assert "no-gravity-seed0 failed" in said

    order(comparison.path, "no-gravity-seed0", "")
    (comparison.folder("full-seed0") / "begun").unlink()
    work(comparison)
    assert set(states(comparison.path).values()) == {"done"}
    assert not (comparison.folder("full-seed0") / "begun").exists()
    log = (comparison.folder("no-gravity-seed0") / "train.log").read_text()
    assert log.count("began no-gravity-seed0") == 2


@pytest.mark.parametrize(("what", "said"), [("die", "signal 9"), ("unmeasured", "without an evaluation")])
def test_what_became_of_a_row_is_said(what: str, said: str, tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity")
    order(comparison.path, "no-gravity-seed0", what)
    work(comparison)
    error = Comparison.read(comparison.path).rows["no-gravity-seed0"].error
    assert error is not None
    assert said in error


def test_rows_fail_whose_hair_failed(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity", seeds=[0, 1])
    order(comparison.path, "hair-seed0", "fail")
    work(comparison)
    assert states(comparison.path) == {
        **dict.fromkeys(("hair-seed0", "full-seed0", "no-gravity-seed0"), "failed"),
        **dict.fromkeys(("hair-seed1", "full-seed1", "no-gravity-seed1"), "done"),
    }
    error = Comparison.read(comparison.path).rows["no-gravity-seed0"].error
    assert error == "it needs hair-seed0, which failed"


def test_rows_that_do_not_fit_are_never_started(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out")
    work(comparison, memory=99)
    assert set(states(comparison.path).values()) == {"failed"}
    assert not (comparison.path / "shared").exists()
    error = comparison.rows["hair-seed0"].error
    assert error is not None
    assert "--memory" in error


def test_another_runs_folder_fails_its_row_alone(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity")
    comparison.folder("no-gravity-seed0").mkdir()
    (comparison.folder("no-gravity-seed0") / "run.json").write_text("{}")
    work(comparison)
    assert states(comparison.path)["full-seed0"] == "done"
    assert states(comparison.path)["no-gravity-seed0"] == "failed"


def test_ctrl_c_lets_rows_save_and_the_same_again_goes_on(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity")
    for name in ("full-seed0", "no-gravity-seed0"):
        order(comparison.path, name, "wait")

    def interrupt() -> None:
        until = time.monotonic() + 30
        waiting = [comparison.folder(name) / "begun" for name in ("full-seed0", "no-gravity-seed0")]
        while time.monotonic() < until and not all(file.exists() for file in waiting):
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt):
        work(comparison)
    assert (comparison.folder("full-seed0") / "saved").exists()
    assert (comparison.folder("no-gravity-seed0") / "saved").exists()
    assert states(comparison.path) == {"hair-seed0": "done", "full-seed0": "pending", "no-gravity-seed0": "pending"}

    for name in ("full-seed0", "no-gravity-seed0"):
        order(comparison.path, name, "")
    work(comparison)
    assert set(states(comparison.path).values()) == {"done"}


def test_a_terminal_shows_a_line_for_each_row(tmp_path: Path) -> None:
    said = work(comparison_of(tmp_path / "out", "no-gravity"), terminal=True)
    assert "it/s" in said
    assert "waiting" in said
    assert "no-gravity-seed0" in said
