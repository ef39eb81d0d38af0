from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from landmark_stand_ins import ring_cameras, round_face, seen_face
from scipy.optimize import least_squares

from dynhair.preprocess.landmarks import FaceInSpace, FaceLandmarks, consistent_views, triangulate
from dynhair.preprocess.landmarks.multiview import project, projection_matrix

FACE = round_face() * [0.09, -0.09, -0.09]  # in the world: y up, towards +z


def matrices(azimuths: list[float]) -> np.ndarray:
    return np.array([projection_matrix(camera) for camera in ring_cameras(azimuths)])


def pixels_of(points: np.ndarray, projections: np.ndarray) -> np.ndarray:
    local = np.einsum("vij,nj->vni", projections, np.c_[points, np.ones(len(points))])
    return local[..., :2] / local[..., 2:]


@given(st.integers(0, 2**32 - 1), st.integers(2, 5))
def test_exact_pixels_give_exact_points(seed: int, views: int):
    generator = np.random.default_rng(seed)
    points = generator.uniform(-0.2, 0.2, (20, 3))
    projections = matrices(np.linspace(-60, 60, views).tolist())
    weights = generator.uniform(0.1, 1, (views, 20))
    np.testing.assert_allclose(triangulate(pixels_of(points, projections), weights, projections), points, atol=1e-9)


def test_noisy_pixels_give_nearly_the_least_reprojection_error():
    generator = np.random.default_rng(0)
    projections = matrices([-50, -10, 20, 70])
    points = generator.uniform(-0.2, 0.2, (6, 3))
    pixels = pixels_of(points, projections) + generator.normal(scale=1.5, size=(4, 6, 2))
    weights = generator.uniform(0.2, 1, (4, 6))
    found = triangulate(pixels, weights, projections)
    for i in range(6):
        residuals = lambda x, i=i: (  # noqa: E731
            np.sqrt(weights[:, i, None]) * (pixels_of(x[None], projections)[:, 0] - pixels[:, i])
        ).ravel()
        best = least_squares(residuals, points[i], xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert (residuals(found[i]) ** 2).sum() < 2 * best.cost * (1 + 1e-3)
        assert np.linalg.norm(found[i] - best.x) < 5e-4


def test_missing_points():
    projections = matrices([-30, 0, 30])
    points = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    pixels = pixels_of(points, projections)
    weights = np.array([[1.0, 1, 0], [1, 0, 0], [1, 0, 1]])
    pixels[weights == 0] = np.nan
    found = triangulate(pixels, weights, projections)
    np.testing.assert_allclose(found[0], points[0], atol=1e-9)
    assert np.isnan(found[1:]).all()


def test_parallel_rays_meet_nowhere():
    projections = matrices([0, 0])
    assert np.isnan(triangulate(np.full((2, 1, 2), 100.0), np.ones((2, 1)), projections)).all()


def test_projection_agrees_with_the_camera():
    import torch

    (camera,) = ring_cameras([35])
    pixels, depths = project(FACE, camera)
    expected, expected_depths = camera.project(torch.from_numpy(FACE).float())
    np.testing.assert_allclose(pixels, expected.numpy(), atol=1e-3)
    np.testing.assert_allclose(depths, expected_depths.numpy(), atol=1e-6)


def looked_at(azimuths: list[float], noise: float = 0.4) -> tuple[list[FaceLandmarks | None], list]:
    generator = np.random.default_rng(0)
    cameras = ring_cameras(azimuths)
    noisy = lambda shape: generator.normal(scale=noise, size=shape)  # noqa: E731
    return [seen_face(FACE, camera, noisy) for camera in cameras], cameras


def moved(face: FaceLandmarks | None, x: float, y: float, visible: float = 1.0) -> FaceLandmarks:
    assert face is not None
    shifted = (face.points + np.array([x, y, 0])).astype(np.float32)
    return FaceLandmarks(shifted, np.full(478, visible, np.float32), face.score, face.blendshapes)


def test_views_that_agree_are_believed():
    faces, cameras = looked_at([-45, -15, 15, 45])
    assert consistent_views(faces, cameras).tolist() == [True] * 4
    space = FaceInSpace.triangulate([face for face in faces if face], cameras)
    assert np.linalg.norm(space.points - FACE, axis=1).max() < 0.01
    assert space.known.all()


@pytest.mark.parametrize("wrong", range(4))
def test_a_view_that_contradicts_the_others_is_not(wrong: int):
    faces, cameras = looked_at([-45, -15, 15, 45])
    faces[wrong] = moved(faces[wrong], 5, 12)
    assert np.flatnonzero(~consistent_views(faces, cameras)).tolist() == [wrong]


def test_misses_are_not_believed_and_do_no_harm():
    faces, cameras = looked_at([-45, -15, 15, 45])
    faces[0] = None
    faces[2] = moved(faces[2], 0, -20)
    assert consistent_views(faces, cameras).tolist() == [False, True, False, True]


def test_a_view_alone_is_believed():
    faces, cameras = looked_at([-45, 15])
    assert consistent_views([faces[0], None], cameras).tolist() == [True, False]
    assert consistent_views([None, None], cameras).tolist() == [False, False]


def test_two_views_that_contradict_each_other_are_both_dropped():
    faces, cameras = looked_at([-30, 30])
    faces[1] = moved(faces[1], 0, 20)
    assert consistent_views(faces, cameras).tolist() == [False, False]


def test_two_views_without_shared_points_are_both_believed():
    faces, cameras = looked_at([-30, 30])
    faces[1] = moved(faces[1], 0, 20, visible=0.0)
    assert consistent_views(faces, cameras).tolist() == [True, True]


def test_square_for_another_view():
    faces, cameras = looked_at([-20, 20], noise=0)
    space = FaceInSpace.triangulate([face for face in faces if face], cameras)
    (third,) = ring_cameras([5])
    square = space.square(third)
    expected = seen_face(FACE, third).square
    assert square is not None
    np.testing.assert_allclose([*square.centre, square.side], [*expected.centre, expected.side], atol=0.05)
    assert space.agrees(seen_face(FACE, third), third)
    (inside,) = ring_cameras([0], distance=0.0)
    assert space.square(inside) is None
