"""Training end to end on a tiny capture: it learns, it resumes exactly, it refuses what it cannot train on."""

from __future__ import annotations

import io
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from quick_runs import CONFIG, assert_same_avatar, with_training
from rich.console import Console

from dynhair.avatar import Avatar
from dynhair.capture import Capture
from dynhair.config import write_config
from dynhair.errors import DynhairError
from dynhair.training.batches import Batch, Batches
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.frames import rest_frame
from dynhair.training.run import Run
from dynhair.training.trainer import train
from synthetic import write_synthetic_capture


def quiet() -> Console:
    return Console(file=io.StringIO())


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=6, views=3, size=32, static_views=4)


@pytest.fixture(scope="module")
def trained(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "run"
    train(capture, out, CONFIG, console=quiet())
    return out


def test_a_run_leaves_an_avatar_a_checkpoint_a_log_and_a_preview(capture: Path, trained: Path) -> None:
    data = Capture.open(capture)
    avatar = Avatar.load(trained / "avatar")
    assert avatar.canonical_strands.shape[1:] == (10, 3)
    track = data.track(data.segment("nod"))
    posed = avatar.pose(track, 3)
    images = avatar.draw(posed, [data.camera(data.segment("nod").start + 3, name) for name in data.camera_names])
    assert images.rgb.shape == (3, 32, 32, 3)
    assert torch.isfinite(images.rgb).all()
    assert images.hair.max() > 0.5
    assert (trained / "preview.png").exists()
    assert list((trained / "log").glob("events.*"))
    assert not list(trained.glob(".*"))


def test_an_avatar_keeps_the_tracked_mesh_as_it_was_at_rest(capture: Path, trained: Path) -> None:
    data, avatar = Capture.open(capture), Avatar.load(trained / "avatar")
    assert data.mesh is not None
    assert avatar.head_mesh is not None
    assert avatar.recording is not None
    rest = avatar.recording.rest
    found = avatar.head_mesh.vertices @ rest.rotation.T + rest.translation
    segment, index = rest_frame(data)
    torch.testing.assert_close(found, torch.from_numpy(data.vertices(segment.start + index)), atol=1e-5, rtol=0)
    assert avatar.head_mesh.faces.tolist() == data.mesh.faces.tolist()


def test_an_interrupted_run_goes_on_to_the_same_avatar(
    capture: Path, trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = Batches.batch

    def interrupted(self: Batches, step: int) -> Batch:
        if step == 8:
            signal.raise_signal(signal.SIGINT)
        return original(self, step)

    out = tmp_path / "run"
    with monkeypatch.context() as patched:
        patched.setattr(Batches, "batch", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train(capture, out, CONFIG, console=quiet())
    assert not Run.open(out).avatar.exists()
    assert 0 < Checkpoint.read(Run.open(out).checkpoint).step < CONFIG.training.iterations
    train(capture, out, CONFIG, resume=True, console=quiet())
    assert_same_avatar(out, trained)


@pytest.mark.slow
def test_a_killed_run_goes_on_to_the_same_avatar(capture: Path, tmp_path: Path) -> None:
    config = with_training(iterations=60, checkpoint_every=10)
    write_config(config, tmp_path / "config.yaml")
    command = [sys.executable, "-m", "dynhair", "train", str(capture), "--config", str(tmp_path / "config.yaml")]
    subprocess.run([*command, "--out", str(tmp_path / "whole")], check=True, stdout=subprocess.DEVNULL, timeout=600)

    out = tmp_path / "killed"
    process = subprocess.Popen([*command, "--out", str(out)], stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 600
    while not Run(out, capture, config).checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not (out / "avatar").exists()
    subprocess.run([*command, "--out", str(out), "--resume"], check=True, stdout=subprocess.DEVNULL, timeout=600)
    assert_same_avatar(out, tmp_path / "whole")


@pytest.mark.slow
def test_training_brings_the_avatar_closer_to_the_images(capture: Path, tmp_path: Path) -> None:
    data = Capture.open(capture)
    segment = data.segments[0]
    track = data.track(segment)

    def error(avatar: Avatar | None) -> float:
        assert avatar is not None
        total = 0.0
        for index in range(segment.count):
            frame = segment.start + index
            cameras = [data.camera(frame, name) for name in data.camera_names]
            with torch.no_grad():
                images = avatar.draw(avatar.pose(track, index), cameras)
            truth = torch.stack([data.view(frame, name).rgb for name in data.camera_names])
            total += float((images.rgb - truth).abs().mean())
        return total / segment.count

    before = error(train(capture, tmp_path / "short", with_training(iterations=1), console=quiet()))
    after = error(train(capture, tmp_path / "long", with_training(iterations=150), console=quiet()))
    assert after < 0.7 * before  # the head begins in the colours of the views


def test_a_taken_folder_and_a_foreign_run_are_refused(capture: Path, trained: Path, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="something already"):
        train(capture, trained, CONFIG, console=quiet())
    with pytest.raises(DynhairError, match="no run to go on with"):
        train(capture, tmp_path / "none", CONFIG, resume=True, console=quiet())
    other = write_synthetic_capture(tmp_path / "other", frames=2, views=2, size=16)
    with pytest.raises(DynhairError, match="trained on"):
        train(other, trained, CONFIG, resume=True, console=quiet())


def test_a_capture_without_hair_masks_is_refused(tmp_path: Path) -> None:
    path = write_synthetic_capture(tmp_path / "c", frames=2, views=2, size=16)
    for mask in path.glob("**/hair_*.png"):
        mask.unlink()
    with pytest.raises(DynhairError, match="hair mask"):
        train(path, tmp_path / "run", CONFIG, console=quiet())


def test_the_static_stage_alone_can_be_gone_on_with(capture: Path, trained: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert train(capture, out, CONFIG, stages=("static",), console=quiet()) is None
    run = Run.open(out)
    assert run.canonical_hair.exists()
    assert not run.avatar.exists()
    train(capture, out, resume=True, console=quiet())
    assert_same_avatar(out, trained)


def test_a_capture_with_nothing_to_train_on_leaves_no_run(capture: Path, tmp_path: Path) -> None:
    tests = tmp_path / "tests"
    shutil.copytree(capture, tests)
    (tests / "capture.json").write_text((tests / "capture.json").read_text().replace('"train"', '"test"'))
    with pytest.raises(DynhairError, match="no segment has the split `train`"):
        train(tests, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_an_unreadable_groom_leaves_no_run(capture: Path, tmp_path: Path) -> None:
    groom = tmp_path / "groom.hair"
    groom.write_bytes(b"HAIRY")
    with pytest.raises(DynhairError, match="groom"):
        train(capture, tmp_path / "run", CONFIG, hair_init=groom, console=quiet())
    assert not (tmp_path / "run").exists()


def test_a_resumed_run_takes_no_other_groom(capture: Path, trained: Path, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="keeps the hair"):
        train(capture, trained, hair_init=tmp_path / "groom.hair", resume=True, console=quiet())
