"""The search for the simulator's parameters, and the run that it makes."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from rich.console import Console
from simulated_heads import haired_avatar

from dynhair.baselines import open_driven_head, train_baseline, tuning
from dynhair.baselines.cables import CableParameters
from dynhair.baselines.simulator import HeadSurface, SimulatedAvatar
from dynhair.baselines.tuning import RANGES, HairOverlap, Trial, best, proposed, tune
from dynhair.capture import Capture
from dynhair.config import Config
from dynhair.errors import DynhairError
from dynhair.training.run import Run
from synthetic import write_synthetic_capture


def closeness(parameters: CableParameters) -> float:
    """Greatest at a drag of 9/s and a Young's modulus of 2e10 Pa."""
    return 1.0 - 0.1 * (math.log(parameters.drag / 9.0) ** 2 + math.log(parameters.young / 2e10) ** 2)


def searched(count: int, seed: int = 0) -> list[Trial]:
    trials: list[Trial] = []
    while len(trials) < count:
        parameters = proposed(trials, seed)
        trials.append(Trial(parameters, closeness(parameters), 1.0))
    return trials


def test_the_search_begins_with_the_defaults_and_finds_the_best() -> None:
    trials = searched(80)
    assert trials[0].parameters == CableParameters()
    assert best(trials).overlap > 0.97
    for trial in trials[1:]:
        for name, (low, high) in RANGES.items():
            assert low * (1 - 1e-9) <= getattr(trial.parameters, name) <= high * (1 + 1e-9)
        assert replace(trial.parameters, **{n: getattr(CableParameters(), n) for n in RANGES}) == CableParameters()


def test_the_search_depends_on_its_seed_alone() -> None:
    assert searched(5) == searched(5)
    assert searched(5) != searched(5, seed=1)


def test_a_search_that_was_cut_off_goes_on_as_if_it_had_not_been(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks = iter(range(1000))
    monkeypatch.setattr(tuning, "time", SimpleNamespace(monotonic=lambda: float(next(ticks))))  # a trial takes 1 s
    console = Console(file=io.StringIO(), width=200)
    path = tmp_path / "trials.json"
    tune(closeness, path, 3 / 60, 0)
    assert len(json.loads(path.read_text())["trials"]) == 3
    found = tune(closeness, path, 8 / 60, 0, console)
    assert found == best(searched(8)).parameters
    assert len(json.loads(path.read_text())["trials"]) == 8
    assert tune(closeness, path, 8 / 60, 0) == found  # its time is up
    path.write_text('{"trials": [{"overlap": 1}]}')
    with pytest.raises(DynhairError, match="damaged"):
        tune(closeness, path, 1.0, 0)


def test_a_simulation_that_diverges_counts_as_none(tmp_path: Path) -> None:
    def diverging(parameters: CableParameters) -> float:
        if parameters != CableParameters():
            raise DynhairError("diverges")
        return 0.1

    assert tune(diverging, tmp_path / "trials.json", 1e-5, 0) == CableParameters()


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=3, views=2, size=24, motions=("turn:train", "nod:test"))


def test_overlap_is_measured_on_training_frames_alone(capture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened, seen = Capture.open(capture), []
    views = Capture.views
    monkeypatch.setattr(Capture, "views", lambda self, requests: seen.extend(requests) or views(self, requests))
    monkeypatch.setattr(Capture, "ground_truth", lambda *_: pytest.fail("the ground truth was read"))
    monkeypatch.setattr(
        SimulatedAvatar, "displacements", lambda self, track: torch.zeros(3, self.guides, 16, 3)[:, :20]
    )
    avatar = haired_avatar()
    overlap = HairOverlap(opened, avatar, HeadSurface.tracked(opened))
    assert {frame for frame, _ in seen} == set(opened.segment("turn").frames)
    assert 0.0 <= overlap(CableParameters()) <= 1.0


def test_a_run_without_tuning_has_the_defaults(capture: Path, tmp_path: Path) -> None:
    haired_avatar().save(tmp_path / "source")
    out = tmp_path / "run"
    train_baseline("simulator", capture, out, Config(), avatar=tmp_path / "source")
    head = open_driven_head(out)
    assert isinstance(head, SimulatedAvatar)
    assert head.parameters == CableParameters()
    assert Run.open(out).capture == capture
    np.testing.assert_array_equal(head.avatar.canonical_strands.detach(), haired_avatar().canonical_strands.detach())


def test_a_run_keeps_what_it_tuned(capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    haired_avatar().save(tmp_path / "source")
    tuned = replace(CableParameters(), drag=3.0)
    monkeypatch.setattr(tuning, "tune", lambda *_: tuned)
    out = tmp_path / "run"
    for _ in range(2):  # the second goes on with the first
        train_baseline("simulator", capture, out, Config(), avatar=tmp_path / "source", minutes=1.0)
    head = open_driven_head(out)
    assert isinstance(head, SimulatedAvatar)
    assert head.parameters == tuned


def test_a_run_needs_an_avatar_and_its_own_capture(capture: Path, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="trained avatar"):
        train_baseline("simulator", capture, tmp_path / "run", Config())
    haired_avatar().save(tmp_path / "source")
    Run.create(tmp_path / "other", tmp_path, Config())
    with pytest.raises(DynhairError, match="another capture"):
        train_baseline("simulator", capture, tmp_path / "other", Config(), avatar=tmp_path / "source")
