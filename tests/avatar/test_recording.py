"""How a person was recorded, kept with the avatar."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dynhair.avatar import Avatar, Recording
from dynhair.capture import Capture
from dynhair.config import Config
from dynhair.errors import DynhairError
from dynhair.training import capture_recording, recording_of
from dynhair.training.run import Run
from synthetic import FPS, HEAD_ORIGIN, write_synthetic_capture
from tiny_avatars import make_avatar


def assert_same(one: Recording, other: Recording) -> None:
    assert one.to_json() == other.to_json()
    torch.testing.assert_close(one.rest.rotation_vector, other.rest.rotation_vector)


@pytest.fixture
def capture(tmp_path: Path) -> Capture:
    return Capture.open(write_synthetic_capture(tmp_path / "capture", frames=2, views=3, with_gt=False))


@pytest.fixture
def run(tmp_path: Path, capture: Capture) -> Path:
    """A run whose avatar was written before recordings were kept."""
    older = make_avatar()
    older.recording = None
    run = Run.create(tmp_path / "run", capture.path, Config())
    older.save(run.avatar)
    return run.path


def test_a_recording_survives_the_avatars_folder(tmp_path: Path) -> None:
    avatar = make_avatar()
    avatar.save(tmp_path / "a")
    kept = Avatar.load(tmp_path / "a").recording
    assert kept is not None
    assert avatar.recording is not None
    assert_same(kept, avatar.recording)
    assert_same(recording_of(tmp_path / "a"), avatar.recording)
    assert kept.gravity.dtype == np.float64
    assert kept.rest.rotation.dtype == kept.camera.w2c.dtype == torch.float32


def test_a_captures_recording_is_its_rest_frame_seen_from_the_front(capture: Capture) -> None:
    recording = capture_recording(capture)
    assert recording.fps == FPS
    np.testing.assert_array_equal(recording.gravity, capture.gravity)
    torch.testing.assert_close(recording.rest.translation, torch.from_numpy(HEAD_ORIGIN).float())
    middle = capture.camera(0, capture.camera_names[1])  # the cameras look from -50, 0 and 50 degrees
    assert torch.equal(recording.camera.w2c, middle.w2c)


def test_an_avatar_that_does_not_say_is_known_by_its_runs_capture(run: Path, capture: Capture) -> None:
    assert Avatar.load(run / "avatar").recording is None
    for folder in (run, run / "avatar", str(run)):
        assert_same(recording_of(folder), capture_recording(capture))


def test_an_avatar_of_which_nothing_is_known_is_refused(run: Path, capture: Capture, tmp_path: Path) -> None:
    shutil.copytree(run / "avatar", tmp_path / "alone")
    with pytest.raises(DynhairError, match="does not say how the person was recorded"):
        recording_of(tmp_path / "alone")
    shutil.rmtree(capture.path)
    with pytest.raises(DynhairError, match="bring the capture back"):
        recording_of(run)
    with pytest.raises(DynhairError, match="missing"):
        recording_of(tmp_path / "nowhere")


@pytest.mark.parametrize(
    "damage",
    [
        {"fps": "often"},
        {"fps": None},
        {"gravity": [0, -9.81]},
        {"gravity": [0, float("inf"), 0]},
        {"rest": {}},
        {"rest": 3},
        {"camera": {"w2c": 1, "K": 2, "width": 3, "height": 4}},
    ],
    ids=str,
)
def test_a_damaged_recording_is_named(damage: dict[str, Any], tmp_path: Path) -> None:
    make_avatar().save(tmp_path / "a")
    path = tmp_path / "a" / "avatar.json"
    description = json.loads(path.read_text())
    description["recording"].update(damage)
    path.write_text(json.dumps(description))
    with pytest.raises(DynhairError, match=r"avatar\.json"):
        recording_of(tmp_path / "a")
    with pytest.raises(DynhairError, match=r"avatar\.json"):
        Avatar.load(tmp_path / "a")
