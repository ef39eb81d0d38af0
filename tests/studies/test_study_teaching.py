"""What dynhair's own dynamics are made by: lessons of several hairstyles, each counted from its roots."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
import pytest
import safetensors.torch
import torch
from rich.console import Console
from scipy.spatial.transform import Rotation
from studies.hair_motion import teaching
from studies.hair_motion.motions import FPS, HALTING_FRAMES, HALTS, head_motion
from studies.hair_motion.recordings import recorded

from dynhair.avatar.strand_dynamics import POINTS, TAUGHT, StrandDynamics


def simulation(path: Path, motion: str) -> Path:
    """A file as the simulation writes it, with hair that hangs beside a head whose origin is elsewhere."""
    moved = head_motion(motion)
    generator = np.random.default_rng(len(path.name))
    rest = np.array([0.3, 0.2, 0.1]) + 0.02 * generator.standard_normal((6, POINTS, 3)).cumsum(1)
    swing = 0.01 * np.sin(np.arange(len(moved.rotations)) / 7)[:, None, None, None] * np.linspace(0, 1, POINTS)[:, None]
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(
        path,
        guides=(rest + swing).astype(np.float32),
        rotations=moved.rotations,
        translations=moved.translations,
    )
    return path


def test_a_lesson_is_counted_from_the_roots(tmp_path: Path) -> None:
    path = simulation(tmp_path / "turn.npz", "turn")
    lesson, moved = recorded(path, about_roots=True), head_motion("turn")
    with np.load(path) as arrays:
        origin = arrays["guides"][0, :, 0].mean(0)
    assert lesson.canonical[:, 0].mean(0).abs().max() < 1e-6
    # what is weighed there is gravity less the acceleration of that point
    places = moved.translations + moved.rotations @ origin
    expected = (
        Rotation.from_matrix(moved.rotations[30])
        .inv()
        .apply([0, -9.81, 0] - (places[31] - 2 * places[30] + places[29]) * FPS**2)
    )
    np.testing.assert_allclose(lesson.signals.pull[30], expected, atol=1e-3)


def test_halting_heads_come_to_rest_twice() -> None:
    for name in HALTS:
        moved = head_motion(name)
        assert len(moved.rotations) == HALTING_FRAMES
        turns = (moved.rotations[:-1].transpose(0, 2, 1) @ moved.rotations[1:]).trace(axis1=1, axis2=2)
        still = turns > 3 - 1e-9
        assert still[78:112].all()
        assert still[134:].all()
        assert not still[10:30].all()
        np.testing.assert_allclose(moved.rotations[-1], np.eye(3), atol=1e-9)
        np.testing.assert_allclose(moved.translations[-1], 0, atol=1e-9)


def test_what_is_taught_is_written_and_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(teaching, "LESSONS", ("turn", "halt1"))
    monkeypatch.setattr(teaching, "GROOMS", ("long", "bob"))
    for groom in ("long", "bob"):
        for motion in ("turn", "halt1"):
            simulation(tmp_path / "simulated" / groom / f"{motion}.npz", motion)
    first = safetensors.torch.load_file(teaching.teach(tmp_path, Console(quiet=True), steps=3))
    (tmp_path / TAUGHT).rename(tmp_path / "first")
    again = safetensors.torch.load_file(teaching.teach(tmp_path, Console(quiet=True), steps=3))
    for name, values in StrandDynamics.taught().state_dict().items():
        assert first[name].shape == values.shape
        assert torch.equal(first[name], again[name])
    with safetensors.safe_open(tmp_path / TAUGHT, "pt") as file:
        assert file.metadata() == teaching.recipe(3)


def test_what_is_bundled_says_how_it_was_made() -> None:
    with as_file(files("dynhair.avatar") / TAUGHT) as path, safetensors.safe_open(path, "pt") as file:
        assert file.metadata() == teaching.recipe(teaching.STEPS)
