"""The real networks, on a photograph and on painted heads."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from skimage.data import astronaut
from tests.preprocess.test_landmark_ibug68 import MIRRORED
from tools.anchor_table import mirrored_points, pose_error
from tools.head_renders import HeadPainter, Look, look_at

from dynhair.face import open_head
from dynhair.face.anchors import open_head_anchors
from dynhair.preprocess.landmarks import (
    BLENDSHAPE_NAMES,
    FaceInSpace,
    FaceLandmarker,
    FaceLandmarks,
    FaceNetworks,
    FaceSquare,
    FaceTrack,
    to_ibug68,
)

pytestmark = pytest.mark.slow
EYES = 33, 133, 362, 263  # corners, from the person's right


@pytest.fixture(scope="module")
def networks() -> FaceNetworks:
    return FaceNetworks.load()


@pytest.fixture(scope="module")
def landmarker(networks: FaceNetworks) -> FaceLandmarker:
    return FaceLandmarker(networks)


@pytest.fixture(scope="module")
def photographed(landmarker: FaceLandmarker) -> FaceLandmarks:
    found = landmarker.detect(astronaut())
    assert found is not None
    return found


def strength(face: FaceLandmarks, name: str) -> float:
    return float(face.blendshapes[BLENDSHAPE_NAMES.index(name)])


def test_a_smiling_woman(photographed: FaceLandmarks):
    assert photographed.score > 0.99
    assert photographed.facing > 0.9
    corners = photographed.points[list(EYES), :2]
    assert (np.diff(corners[:, 0]) > 10).all()
    assert (np.abs(corners - [[196, 101], [214, 104], [237, 105], [256, 104]]) < 5).all()
    assert min(strength(photographed, "mouthSmileLeft"), strength(photographed, "mouthSmileRight")) > 0.7
    assert max(strength(photographed, "eyeBlinkLeft"), strength(photographed, "mouthPucker")) < 0.3


def test_points_turn_with_the_picture(landmarker: FaceLandmarker, photographed: FaceLandmarks):
    turned = FaceSquare((224.0, 130.0), 300.0, np.radians(-30.0))
    found = landmarker.detect(turned.crop(astronaut(), 450))
    assert found is not None
    expected = turned.from_image(photographed.points[:, :2].astype(np.float64)) * 450
    assert np.median(np.linalg.norm(found.points[:, :2] - expected, axis=1)) < 2
    np.testing.assert_allclose(found.blendshapes, photographed.blendshapes, atol=0.15)


def test_a_mirrored_picture_has_mirrored_points(
    landmarker: FaceLandmarker, networks: FaceNetworks, photographed: FaceLandmarks
):
    picture = astronaut()
    found = landmarker.detect(np.ascontiguousarray(picture[:, ::-1]))
    assert found is not None
    expected = photographed.points[mirrored_points(networks.mesh), :2] * [-1, 1] + [picture.shape[1], 0]
    assert np.median(np.linalg.norm(found.points[:, :2] - expected, axis=1)) < 1.5


def test_no_face_in_noise(landmarker: FaceLandmarker):
    noise = np.random.default_rng(0).integers(0, 256, (300, 400, 3), np.uint8)
    assert landmarker.detect(noise) is None


def test_ibug68_is_symmetric_on_the_canonical_face(networks: FaceNetworks):
    face = to_ibug68(np.concatenate([networks.mesh.vertices, np.zeros((10, 3), np.float32)]))
    np.testing.assert_allclose(face[list(MIRRORED)], face * [-1, 1, 1], atol=1e-5)
    assert (np.diff(face[:17, 0]) > 0).all()  # the jaw runs from the person's right, at -x, to the left
    assert face[8, 1] == face[:, 1].min()
    assert (np.diff(face[27:31, 1]) < 0).all()  # down the nose
    steps = np.linalg.norm(np.diff(face[:17], axis=0), axis=1)
    assert steps.max() < 1.7 * steps.min()


def draw_head(yaw: float, identity: np.ndarray | None = None, pitch: float = 0.0):
    model = open_head()
    vertices = model.vertices(None if identity is None else torch.from_numpy(identity)).double().numpy()
    camera = look_at(np.array([0.0, 0.02, 0.06]), yaw, pitch, 0.0, 1.0, 1100.0, 320)
    picture = HeadPainter(model).draw(vertices, camera, Look.draw(np.random.default_rng(1)))
    return picture, camera, vertices


@pytest.mark.parametrize("yaw", [-30.0, 0.0, 20.0])
def test_anchors_give_the_pose_of_a_painted_head(landmarker: FaceLandmarker, yaw: float):
    picture, camera, vertices = draw_head(yaw)
    found = landmarker.detect(picture)
    assert found is not None
    anchors = open_head_anchors()
    shape = anchors.positions(vertices, open_head().faces.numpy())
    turn, shift = pose_error(shape, anchors, found, camera)
    assert np.degrees(np.abs(turn)).max() < 3
    assert np.abs(shift).max() < 0.02
    assert found.facing == pytest.approx(np.cos(np.radians(yaw)), abs=0.1)


def test_painted_heads_from_several_sides_agree_in_space(landmarker: FaceLandmarker):
    identity = np.random.default_rng(3).normal(size=len(open_head().identity_modes)).astype(np.float32)
    pictures, cameras, heads = zip(*(draw_head(yaw, identity) for yaw in (-25, 0, 25, 170)), strict=True)
    faces = FaceTrack(landmarker).follow(pictures, cameras)
    assert [face is not None for face in faces] == [True, True, True, False]
    space = FaceInSpace.triangulate([face for face in faces if face], cameras[:3])
    anchors = open_head_anchors()
    truth = anchors.positions(heads[0], open_head().faces.numpy())
    errors = np.linalg.norm(space.points[anchors.points] - truth, axis=1)[space.known[anchors.points]]
    assert np.median(errors) < 0.005


def test_what_is_turned_away_counts_less(landmarker: FaceLandmarker):
    picture, _, _ = draw_head(45.0)
    found = landmarker.detect(picture)
    assert found is not None
    right, left = found.visibility[[234, 93, 132]], found.visibility[[454, 323, 361]]
    assert left.min() > right.max()  # the camera stands on the person's left
    assert found.confidence.max() < 0.95
