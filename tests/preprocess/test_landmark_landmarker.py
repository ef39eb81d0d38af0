from __future__ import annotations

import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from landmark_stand_ins import disc_image, disc_networks, round_face, round_mesh
from scipy.spatial.transform import Rotation

from dynhair.errors import DynhairError
from dynhair.preprocess.landmarks import BLENDSHAPE_NAMES, FaceLandmarker, FaceLandmarks, FaceNetworks, FaceSquare
from dynhair.preprocess.landmarks.blendshapes import BLENDSHAPE_POINTS
from dynhair.preprocess.landmarks.networks import FaceMesh
from dynhair.preprocess.landmarks.visibility import point_visibility, vertex_normals


def test_search_finds_the_face_and_places_its_points():
    found = FaceLandmarker(disc_networks()).detect(disc_image((130, 70), 30))
    assert found is not None
    np.testing.assert_allclose(found.points, round_face() * 30 + [130, 70, 0], atol=0.5)
    assert found.score == pytest.approx(1 / (1 + np.exp(-5)))
    assert found.blendshapes.shape == (52,)
    np.testing.assert_allclose(found.square.centre, [130, 70], atol=0.5)
    assert found.square.side == pytest.approx(90, abs=1)


def test_a_good_hint_saves_the_search():
    calls: list[str] = []
    image = disc_image((130, 70), 30)
    found = FaceLandmarker(disc_networks(calls)).detect(image, FaceSquare((125.0, 75.0), 100.0))
    assert found is not None
    np.testing.assert_allclose(found.points[:, :2], round_face()[:, :2] * 30 + [130, 70], atol=1)
    assert "boxes" not in calls


def test_a_wrong_hint_falls_back_to_the_search():
    calls: list[str] = []
    found = FaceLandmarker(disc_networks(calls)).detect(disc_image((130, 70), 30), FaceSquare((20.0, 140.0), 30.0))
    assert found is not None
    assert calls[:2] == ["points", "boxes"]


def test_no_face_is_none():
    landmarker = FaceLandmarker(disc_networks())
    black = np.zeros((60, 80, 3), np.uint8)
    assert landmarker.detect(black) is None
    assert landmarker.detect(black, FaceSquare((40.0, 30.0), 50.0)) is None
    assert landmarker.detect_at(black, FaceSquare((40.0, 30.0), 50.0)) is None


def test_a_low_score_is_none():
    networks = disc_networks()
    doubtful = replace(networks, points=lambda crop: (networks.points(crop)[0], -0.1))
    assert FaceLandmarker(doubtful).detect(disc_image((100, 80), 40)) is None


def test_visibility_follows_the_surface():
    face, mesh = round_face(), round_mesh()
    visibility = point_visibility(face, mesh.faces)
    assert visibility.shape == (478,)
    depth = -face[:468, 2]  # on a sphere, the cosine to the line of sight
    assert (visibility[:468][depth > 0.5] == 1).all()
    assert (visibility[:468][depth < 0.02] < 1).all()
    # from behind nothing is seen
    behind = point_visibility(face * [-1, 1, -1], mesh.faces)
    assert behind[:468][depth > 0.5].max() == pytest.approx(0.1)


def turned_face(yaw: float) -> FaceLandmarks:
    face = round_face()
    face[[10, 152]] = [[0, -0.6, -0.8], [0, 0.6, -0.8]]
    turned = Rotation.from_euler("y", yaw, degrees=True).apply(face).astype(np.float32)
    return FaceLandmarks(100 * turned, np.ones(478, np.float32), 0.8, np.zeros(52, np.float32))


@pytest.mark.parametrize("yaw", [0.0, 25.0, -50.0, 85.0, 170.0])
def test_facing_is_the_cosine_of_the_turn(yaw: float):
    assert turned_face(yaw).facing == pytest.approx(np.cos(np.radians(yaw)), abs=1e-5)


def test_confidence_falls_with_the_turn_and_the_score():
    confidences = [float(turned_face(yaw).confidence[0]) for yaw in (0.0, 20.0, 40.0, 60.0, 89.0)]
    assert confidences[0] == confidences[1] == pytest.approx(0.8)
    assert confidences[1] > confidences[2] > confidences[3] > confidences[4] > 0


def test_normals_of_a_triangle_and_of_a_lonely_vertex():
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [5, 5, 5]])
    normals = vertex_normals(vertices, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(normals, [[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 0]])


def test_tables_of_blendshapes():
    assert len(BLENDSHAPE_NAMES) == len(set(BLENDSHAPE_NAMES)) == 52
    assert len(BLENDSHAPE_POINTS) == len(set(BLENDSHAPE_POINTS)) == 146
    assert tuple(sorted(BLENDSHAPE_POINTS)) == BLENDSHAPE_POINTS
    assert BLENDSHAPE_POINTS[-1] == 477
    for name in BLENDSHAPE_NAMES:
        other = name.replace("Left", "Right") if "Left" in name else name.replace("Right", "Left")
        assert other in {*BLENDSHAPE_NAMES, "mouthLeft", "jawLeft"}


def varint(value: int) -> bytes:
    parts = []
    while value > 0x7F:
        parts.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*parts, value])


def test_reading_the_mesh_from_its_protocol_buffer():
    vertices = np.random.default_rng(0).normal(size=(468, 5)).astype(np.float32)
    triangles = [(0, 1, 2), (467, 300, 128)]
    mesh = b"\x08\x00" + b"".join(b"\x1d" + struct.pack("<f", value) for value in vertices.ravel())
    mesh += b"".join(b"\x20" + varint(index) for triangle in triangles for index in triangle)
    content = b"\x0a" + varint(len(mesh)) + mesh + b"\x18\x01"
    read = FaceMesh.parse(content)
    np.testing.assert_array_equal(read.vertices, vertices[:, :3])
    np.testing.assert_array_equal(read.faces, triangles)


def test_files_that_are_no_landmarkers(tmp_path: Path):
    with pytest.raises(DynhairError, match="not readable"):
        FaceNetworks.load(tmp_path / "missing.task")
    torn = tmp_path / "torn.task"
    torn.write_bytes(b"no archive")
    with pytest.raises(DynhairError, match="not readable"):
        FaceNetworks.load(torn)
    other = tmp_path / "other.task"
    with zipfile.ZipFile(other, "w") as bundle:
        bundle.writestr("hand_detector.tflite", b"")
    with pytest.raises(DynhairError, match="face_detector"):
        FaceNetworks.load(other)
