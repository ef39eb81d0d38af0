"""The TensorBoard log, and a disk that is full."""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dynhair.training.training_log import TrainingLog


def test_curves_and_pictures_are_kept(tmp_path: Path) -> None:
    complaints: list[str] = []
    with TrainingLog(tmp_path / "log", 0, complaints.append) as log:
        for step in (10, 20):
            log.curves({"loss": 1.0 / step, "skipped steps": 0.0}, step)
        log.picture("avatar", np.zeros((4, 6, 3), np.uint8), 20)
    events = EventAccumulator(str(tmp_path / "log"))
    events.Reload()
    assert [(event.step, event.value) for event in events.Scalars("loss")] == [
        (10, pytest.approx(0.1)),
        (20, pytest.approx(0.05)),
    ]
    assert events.Tags()["images"] == ["avatar"]
    assert not complaints


def test_no_log_is_written_where_none_is_wanted(tmp_path: Path) -> None:
    with TrainingLog(None, 0, pytest.fail) as log:
        log.curves({"loss": 1.0}, 1)
        log.picture("avatar", np.zeros((4, 6, 3), np.uint8), 1)
    assert not list(tmp_path.iterdir())


def test_a_log_that_cannot_be_begun_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "log").write_text("in the way")
    complaints: list[str] = []
    with TrainingLog(tmp_path / "log", 0, complaints.append) as log:
        log.curves({"loss": 1.0}, 1)
    assert len(complaints) == 1
    assert "cannot be written" in complaints[0]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_disk_that_fills_up_ends_the_log_alone(tmp_path: Path) -> None:
    complaints: list[str] = []
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with TrainingLog(tmp_path / "log", 0, complaints.append) as log:
        log.curves({"loss": 1.0}, 1)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2048, hard))
        try:
            for step in range(2, 200):
                log.picture("avatar", np.random.default_rng(step).integers(0, 255, (64, 64, 3), np.uint8), step)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(complaints) == 1
    assert str(tmp_path / "log") in complaints[0]
