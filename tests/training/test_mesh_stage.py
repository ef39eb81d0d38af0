"""The mesh stage on a tiny capture."""

from __future__ import annotations

import io
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from rich.console import Console
from torch import Tensor

from dynhair.avatar import head_pose
from dynhair.avatar.mesh_head import MeshHead
from dynhair.capture import Capture
from dynhair.config import Config, HeadConfig
from dynhair.errors import DynhairError
from dynhair.mesh import chamfer, surface_samples
from dynhair.mesh_config import MeshHeadConfig
from dynhair.progress import StageProgress
from dynhair.training.batches import Batch
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.mesh_objective import MeshObjective, MeshStep
from dynhair.training.mesh_stage import MeshStage
from dynhair.training.run import Run
from synthetic import write_synthetic_capture

MESH = MeshHeadConfig(
    resolution=8,
    width=48,
    layers=3,
    pretraining_iterations=120,
    iterations=8,
    views=2,
    image_size=48,
    refresh_every=5,
    checkpoint_every=3,
)
CONFIG = Config(head=HeadConfig(features=4, deformation_width=8, appearance_width=8), mesh=MESH)


@pytest.fixture(scope="module")
def capture_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_synthetic_capture(tmp_path_factory.mktemp("data") / "capture", frames=3, views=3, size=48)


def stage(path: Path, out: Path, config: Config = CONFIG, *, resume: bool = False) -> MeshStage:
    capture = Capture.open(path)
    run = Run.open(out) if resume else Run.create(out, capture.path, config)
    console = Console(file=io.StringIO())
    return MeshStage(run, capture, StageProgress(console), console)


def with_steps(iterations: int, seed: int = 0) -> Config:
    mesh = replace(MESH, iterations=iterations)
    return replace(CONFIG, mesh=mesh, training=replace(CONFIG.training, seed=seed))


def same(a: MeshHead, b: MeshHead) -> bool:
    first, second = a.state_dict(), b.state_dict()
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


@pytest.fixture(scope="module")
def whole(capture_path: Path, tmp_path_factory: pytest.TempPathFactory) -> MeshHead:
    """What an uninterrupted stage makes."""
    return stage(capture_path, tmp_path_factory.mktemp("whole") / "run").finish()


def test_another_seed_makes_another_head(capture_path: Path, tmp_path: Path, whole: MeshHead) -> None:
    assert not same(stage(capture_path, tmp_path / "run", with_steps(8, seed=1)).finish(), whole)


@pytest.mark.parametrize("stopped_after", [1, 4])
def test_an_interrupted_stage_goes_on_to_the_same_head(
    capture_path: Path, tmp_path: Path, whole: MeshHead, monkeypatch: pytest.MonkeyPatch, stopped_after: int
) -> None:
    calls = 0
    original = MeshObjective.__call__

    def interrupted(self: MeshObjective, head: MeshHead, batch: Batch) -> MeshStep:
        nonlocal calls
        calls += 1
        if calls == stopped_after:
            signal.raise_signal(signal.SIGINT)
        return original(self, head, batch)

    with monkeypatch.context() as patched:
        patched.setattr(MeshObjective, "__call__", interrupted)
        with pytest.raises(KeyboardInterrupt):
            stage(capture_path, tmp_path / "run").finish()
    assert calls == stopped_after
    assert same(stage(capture_path, tmp_path / "run", resume=True).finish(), whole)


def test_a_kill_costs_no_more_than_the_steps_since_the_checkpoint(
    capture_path: Path, tmp_path: Path, whole: MeshHead, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = 0
    original = MeshObjective.__call__

    def killed(self: MeshObjective, head: MeshHead, batch: Batch) -> MeshStep:
        nonlocal calls
        calls += 1
        if calls == 6:
            raise RuntimeError("killed")
        return original(self, head, batch)

    with monkeypatch.context() as patched:
        patched.setattr(MeshObjective, "__call__", killed)
        with pytest.raises(RuntimeError, match="killed"):
            stage(capture_path, tmp_path / "run").finish()
        calls = 100
        assert same(stage(capture_path, tmp_path / "run", resume=True).finish(), whole)
    assert calls == 100 + 8 - 3


def test_a_finished_stage_is_read_not_done_again(
    capture_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = stage(capture_path, tmp_path / "run", with_steps(2))
    head = done.finish()
    assert np.asarray(Image.open(done.preview)).shape[1] > 3 * 48
    monkeypatch.setattr(MeshObjective, "__call__", lambda *_: pytest.fail("a step was done"))
    again = stage(capture_path, tmp_path / "run", resume=True).finish()
    assert same(again, head)
    with torch.no_grad():
        assert torch.equal(again.canonical().vertices, head.canonical().vertices)


def test_a_damaged_result_is_refused(capture_path: Path, tmp_path: Path) -> None:
    done = stage(capture_path, tmp_path / "run", with_steps(1))
    done.finish()
    done.result.write_bytes(b"nothing")
    with pytest.raises(DynhairError, match="not readable"):
        stage(capture_path, tmp_path / "run", resume=True).finish()


def test_ground_truth_test_segments_and_the_tracked_shape_are_not_read(
    capture_path: Path, tmp_path: Path, whole: MeshHead
) -> None:
    copy = tmp_path / "capture"
    shutil.copytree(capture_path, copy)
    shutil.rmtree(copy / "gt")
    capture = Capture.open(copy)
    for segment in capture.segments:
        if segment.split == "test":
            for frame in segment.frames:
                shutil.rmtree(capture.layout.frame_images(frame))
    for frame in range(1, 3):  # the mesh of the rest frame says what follows the head
        capture.layout.vertices(frame).unlink()
    assert same(stage(copy, tmp_path / "run").finish(), whole)


def test_masks_that_show_nobody_are_refused(capture_path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "capture"
    shutil.copytree(capture_path, copy)
    for mask in copy.glob("images/*/mask_*.png"):
        Image.fromarray(np.zeros((48, 48), np.uint8)).save(mask)
    with pytest.raises(DynhairError, match="no room for a head"):
        stage(copy, tmp_path / "run")


def test_hair_masks_are_needed(capture_path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "capture"
    shutil.copytree(capture_path, copy)
    for mask in copy.glob("**/hair_*.png"):
        mask.unlink()
    with pytest.raises(DynhairError, match="no hair masks"):
        stage(copy, tmp_path / "run").finish()


@pytest.mark.slow
def test_the_head_comes_closer_to_the_truth(tmp_path: Path) -> None:
    path = write_synthetic_capture(tmp_path / "capture", frames=4, views=4, size=64)
    capture = Capture.open(path)

    def distance(iterations: int) -> float:
        head = stage(path, tmp_path / str(iterations), with_steps(iterations)).finish()
        segment, index = rest_frame(capture)
        track = capture.track(segment)
        to_head = head_frame(track, index)
        with torch.no_grad():
            mesh = head(head_pose(track, index))
        assert capture.mesh is not None
        truth = to_head(torch.from_numpy(capture.vertices(segment.start + index)))
        wanted = surface_samples(truth, torch.from_numpy(capture.mesh.faces), 4000, 0)
        found = surface_samples(to_head(mesh.vertices), mesh.faces, 4000, 0)
        return chamfer(front(found), front(wanted))

    def front(points: Tensor) -> Tensor:
        return points[points[:, 2] > 0.02]

    assert distance(150) < 0.6 * distance(0)
