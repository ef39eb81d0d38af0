"""The tracked surface: the capture's own mesh, or the open head that follows pose and expression."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from meshless import true_head, write_meshless_capture
from rich.console import Console

from dynhair.capture import Capture
from dynhair.config import Config, DeformerConfig, HairConfig, HeadConfig, StaticConfig, TrainingConfig
from dynhair.errors import DynhairError
from dynhair.face import open_head
from dynhair.strands import MeshDistance
from dynhair.training.surface import RegisteredHead, tracked_surface
from dynhair.training.trainer import train
from synthetic import HEAD_ORIGIN, write_synthetic_capture

FRAMES = 6


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    return Capture.open(write_meshless_capture(tmp_path_factory.mktemp("data") / "capture", frames=FRAMES))


@pytest.fixture(scope="module")
def surface(capture: Capture) -> RegisteredHead:
    surface = tracked_surface(capture)
    assert isinstance(surface, RegisteredHead)
    return surface


def test_a_capture_with_a_mesh_keeps_it(tmp_path: Path) -> None:
    capture = Capture.open(write_synthetic_capture(tmp_path / "c", frames=2, views=2, size=16))
    assert capture.mesh is not None
    surface = tracked_surface(capture)
    np.testing.assert_array_equal(surface.faces.numpy(), capture.mesh.faces)
    np.testing.assert_array_equal(surface.scalp.numpy(), capture.mesh.scalp)
    np.testing.assert_array_equal(surface.vertices(1).numpy(), capture.vertices(1))


def test_faces_and_scalp_are_the_open_heads(surface: RegisteredHead) -> None:
    assert surface.faces is open_head().faces
    assert surface.scalp is open_head().scalp


def test_the_registered_head_follows_pose_and_expression(capture: Capture, surface: RegisteredHead) -> None:
    on_head = open_head().head_weight == 1
    segment = capture.segments[0]
    track = capture.track(segment)
    assert np.abs(track.rotations - track.rotations[0]).max() > 0.3
    for index, frame in enumerate(segment.frames):
        truth = true_head(track.expressions[index]).double().numpy() @ track.rotations[index].T
        error = surface.vertices(frame).numpy() - (truth + track.translations[index])
        assert np.linalg.norm(error[on_head], axis=1).max() < 0.015
        assert np.linalg.norm(error[on_head], axis=1).mean() < 0.001


def test_the_head_moves_rigidly_where_the_face_does_not_move(capture: Capture, surface: RegisteredHead) -> None:
    skull = open_head().faces[open_head().scalp].unique()
    skull = skull[open_head().head_weight[skull] == 1]
    track = capture.track(capture.segments[0])

    def head_local(index: int) -> np.ndarray:
        return (surface.vertices(index).numpy()[skull] - track.translations[index]) @ track.rotations[index]

    np.testing.assert_allclose(head_local(3), head_local(0), atol=2e-4)


def test_shoulders_rest_and_the_neck_lies_between(surface: RegisteredHead) -> None:
    weight = open_head().head_weight
    moved = (surface.vertices(2) - surface.vertices(0)).norm(dim=1)
    assert moved[weight == 0].max() < 1e-6
    assert moved[weight == 1].median() > 0.01
    neck = (weight > 0.4) & (weight < 0.6)
    assert 0 < moved[neck].mean() < moved[weight == 1].mean()


def test_later_segments_have_poses_of_their_own(tmp_path: Path) -> None:
    path = write_meshless_capture(tmp_path / "c")
    shutil.rmtree(path / "images" / "0002")
    capture = Capture.open(path)
    assert [segment.start for segment in capture.segments] == [0, 3]
    surface = tracked_surface(capture)
    for frame in (1, 3, 6):
        landmarks = surface.vertices(frame)[open_head().landmarks66].numpy()
        assert np.linalg.norm(landmarks - capture.landmarks_3d(frame), axis=1).mean() < 0.002


def test_landmarks_that_are_no_face_are_refused_by_their_file(tmp_path: Path) -> None:
    path = write_meshless_capture(tmp_path / "c", frames=2)
    file = path / "params" / "0000" / "lmk_3d.npy"
    np.save(file, np.load(file)[::-1])
    with pytest.raises(DynhairError, match="do not form a face") as caught:
        tracked_surface(Capture.open(path))
    assert caught.value.path == file
    file.unlink()
    with pytest.raises(DynhairError, match="lmk_3d"):
        tracked_surface(Capture.open(path))


def test_rest_shape_is_that_of_the_static_frame(surface: RegisteredHead) -> None:
    assert surface.rest == 0
    torch.testing.assert_close(
        surface.registration.vertices(surface.registration.expression_change(torch.zeros(66, 3))),
        surface.registration.vertices(),
    )


def test_a_capture_without_a_mesh_trains(tmp_path: Path) -> None:
    path = write_meshless_capture(tmp_path / "c")
    config = Config(
        hair=HairConfig(strands=30, points=8, deformer=DeformerConfig(hidden=8, width=16)),
        static=StaticConfig(encoder_iterations=1, iterations=2),
        head=HeadConfig(gaussians=500, features=4, deformation_width=16, appearance_width=8),
        training=TrainingConfig(iterations=3, image_size=24, precision="float32"),
    )
    avatar = train(path, tmp_path / "run", config, console=Console(file=io.StringIO()))
    assert avatar is not None
    surface = tracked_surface(Capture.open(path))
    distances, _ = MeshDistance(surface.vertices(0) - torch.from_numpy(HEAD_ORIGIN).float(), surface.faces).query(
        avatar.canonical_strands[:, 0]
    )
    assert distances.abs().max() < 0.01
