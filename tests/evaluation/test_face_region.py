"""Where the face is, in views from all around."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from stand_ins import StandInCapture

from dynhair.camera import Camera
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.evaluation.face import Square, face_region, frontality, projected_hull, square_round
from synthetic import write_synthetic_capture


def camera_at(centre: np.ndarray, rotation: np.ndarray) -> Camera:
    w2c = torch.from_numpy(np.c_[rotation, -rotation @ centre]).float()
    return Camera(w2c, torch.tensor([[90.0, 0.0, 24.0], [0.0, 90.0, 24.0], [0.0, 0.0, 1.0]]), 48, 48)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    return Capture.open(write_synthetic_capture(tmp_path_factory.mktemp("face") / "capture", frames=3))


def test_the_face_is_the_hull_of_its_landmarks(capture: Capture) -> None:
    segment = capture.segment("nod")
    cameras = [capture.camera(segment.start + 1, name) for name in capture.camera_names]
    face = face_region(capture, segment, 1, cameras)
    centres = np.stack(np.meshgrid(np.arange(48) + 0.5, np.arange(48) + 0.5), axis=-1)
    for pixels, square, camera in zip(face.pixels.numpy(), face.squares, cameras, strict=True):
        projected = camera.project(torch.from_numpy(capture.landmarks_3d(segment.start + 1)))[0].double().numpy()
        np.testing.assert_array_equal(pixels, Delaunay(projected).find_simplex(centres) >= 0)
        assert square == square_round(pixels)
        assert 20 < pixels.sum() < 400


def test_views_from_behind_show_no_face(capture: Capture) -> None:
    segment = capture.segments[0]
    head = capture.track(segment).translations[0]
    metre = np.array([0.0, 0.0, 1.0])
    front = camera_at(head + metre, np.diag([1.0, -1.0, -1.0]))
    behind = camera_at(head - metre, np.diag([-1.0, -1.0, 1.0]))
    np.testing.assert_allclose(frontality(capture, segment, 0, [front, behind]), [1.0, -1.0], atol=1e-6)
    face = face_region(capture, segment, 0, [front, behind])
    assert face.pixels[0].any()
    assert not face.pixels[1].any()
    assert face.squares[1] is None


def test_points_behind_the_camera_select_nothing() -> None:
    points = torch.tensor([[0.1, 0.0, 1.0], [0.0, 0.1, 1.0], [-0.1, -0.1, 1.0]])
    camera = camera_at(np.zeros(3), np.eye(3))
    assert projected_hull(points, camera).any()
    assert not projected_hull(torch.cat([points, torch.tensor([[0.0, 0.0, -1.0]])]), camera).any()


def test_a_capture_without_landmarks_is_refused() -> None:
    capture = StandInCapture()
    with pytest.raises(DynhairError):
        face_region(capture, capture.segments[0], 0, [capture.camera(3, "front")])


@given(
    st.integers(0, 29), st.integers(0, 39), st.integers(1, 30), st.integers(1, 40), st.sampled_from([0.0, 0.25, 1.0])
)
def test_the_square_is_in_the_image_and_holds_the_region(
    top: int, left: int, height: int, width: int, margin: float
) -> None:
    region = np.zeros((30, 40), bool)
    region[top : top + height, left : left + width] = True
    square = square_round(region, margin)
    assert square is not None
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    assert square.side == min(round(max(len(rows), len(columns)) * (1 + 2 * margin)), 30)
    assert 0 <= square.top <= 30 - square.side
    assert 0 <= square.left <= 40 - square.side
    assert square.top <= rows[0]
    assert rows[-1] < square.top + square.side
    if len(columns) <= square.side:
        assert square.left <= columns[0]
        assert columns[-1] < square.left + square.side


def test_an_empty_region_has_no_square() -> None:
    assert square_round(np.zeros((5, 5), bool)) is None


def test_a_crop_is_the_square() -> None:
    image = torch.rand(12, 16, 3)
    torch.testing.assert_close(Square(3, 2, 5).crop(image), image[2:7, 3:8])
