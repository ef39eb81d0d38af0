from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.optimize import minimize
from tools.anchor_table import Picture, _closest_in_triangle, _drifting_median, find_anchors, pose_error
from tools.head_renders import HeadPainter, Look, look_at
from tools.ray_cast import RayCaster

from dynhair.face import open_head
from dynhair.face.anchors import open_head_anchors
from dynhair.preprocess.landmarks import FaceLandmarks

MODEL = open_head()
TRIANGLES = MODEL.faces.numpy()
MEAN = MODEL.mean.double().numpy()


def places() -> dict[int, np.ndarray]:
    anchors = open_head_anchors()
    return dict(zip(anchors.points.tolist(), anchors.positions(MEAN, TRIANGLES), strict=True))


def test_anchors_are_well_formed():
    anchors = open_head_anchors()
    assert len(anchors.points) > 400
    assert (np.diff(anchors.points) > 0).all()
    assert anchors.points[0] >= 0
    assert anchors.points[-1] < 478
    assert anchors.faces.min() >= 0
    assert anchors.faces.max() < len(TRIANGLES)
    np.testing.assert_allclose(anchors.barycentric.sum(1), 1, atol=1e-5)
    assert anchors.barycentric.min() > -1e-5
    assert anchors.deviation.min() > 0
    assert anchors.deviation.max() < 0.005


def test_anchors_lie_where_their_names_say():
    at = places()
    landmarks = MEAN[MODEL.landmarks68.numpy()]
    for point, landmark in {33: 36, 133: 39, 362: 42, 263: 45, 61: 48, 291: 54, 0: 51, 17: 57, 4: 30, 105: 19}.items():
        assert np.linalg.norm(at[point] - landmarks[landmark]) < 0.009, point
    assert at[10][1] > at[9][1] > at[168][1] > at[4][1] > at[0][1] > at[17][1] > at[199][1]
    # jaw, mouth and lids are there, so that expressions can be followed
    assert {13, 14, 78, 308, 159, 145, 386, 374, 199, 200, 18} <= at.keys()


@pytest.mark.parametrize(
    ("right", "left"), [(33, 263), (133, 362), (61, 291), (105, 334), (98, 327), (159, 386), (50, 280), (468, 473)]
)
def test_partners_mirror_each_other(right: int, left: int):
    at = places()
    assert np.linalg.norm(at[right] * [-1, 1, 1] - at[left]) < 0.003
    assert at[right][0] < 0 < at[left][0]


def test_rays_meet_a_plane_where_they_must():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    caster = RayCaster(vertices, np.array([[0, 1, 2], [1, 3, 2]]))
    generator = np.random.default_rng(0)
    target = np.c_[generator.uniform(0.05, 0.95, (50, 2)), np.zeros(50)]
    origins = generator.uniform(-1, 1, (50, 3)) + np.array([0, 0, 3])
    directions = (target - origins) / np.linalg.norm(target - origins, axis=1, keepdims=True)
    faces, barycentric = caster.cast(origins, directions)
    met = np.einsum("nc,ncd->nd", barycentric, vertices[np.array([[0, 1, 2], [1, 3, 2]])[faces]])
    np.testing.assert_allclose(met, target, atol=1e-5)
    assert (caster.cast(origins, -directions)[0] == -1).all()
    assert (caster.cast(origins, directions, reach=0.5)[0] == -1).all()


def test_a_camera_that_looks_at_the_face():
    camera = look_at(np.array([0.0, 0.1, 0.2]), 30, 20, 10, 2.0, 500, 200)
    pixels, depths = camera.project(torch.tensor([[0.0, 0.1, 0.2]]))
    np.testing.assert_allclose(pixels, [[100, 100]], atol=1e-3)
    np.testing.assert_allclose(depths, [2], atol=1e-5)
    centre = camera.centre.numpy()
    assert centre[0] > 0.5  # on the person's left
    assert centre[1] > 0.5  # above
    assert centre[2] > 1


def test_closest_point_of_a_triangle():
    generator = np.random.default_rng(0)
    for _ in range(30):
        corners, point = generator.normal(size=(3, 3)), generator.normal(size=3) * 2
        weights = _closest_in_triangle(point, corners)
        assert weights.min() >= 0
        assert weights.sum() == pytest.approx(1)
        objective = lambda w, c=corners, p=point: float(((w @ c - p) ** 2).sum())  # noqa: E731
        best = minimize(
            objective, np.full(3, 1 / 3), bounds=[(0, 1)] * 3, constraints={"type": "eq", "fun": lambda w: w.sum() - 1}
        )
        assert objective(weights) <= best.fun + 1e-6


def test_place_and_drift_are_told_from_each_other_and_from_strays():
    generator = np.random.default_rng(0)
    sights = generator.uniform(-0.6, 0.6, size=(60, 2))
    place, drift = np.array([0.01, -0.02, 0.05]), generator.normal(scale=0.01, size=(3, 2))
    points = place + sights @ drift.T + generator.normal(scale=5e-4, size=(60, 3))
    points[::9] += 0.3
    found_place, found_drift = _drifting_median(points, sights)
    assert np.abs(found_place - place).max() < 5e-4
    assert np.abs(found_drift - drift).max() < 1e-3


def test_a_point_that_drifts_is_believed_where_it_is_seen_from():
    anchors = open_head_anchors()
    assert np.isfinite(anchors.drift).all()
    assert np.abs(anchors.drift).max() < 0.03
    front, side = anchors.displacements(np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 0.87]]))
    assert not front.any()
    np.testing.assert_allclose(side, 0.5 * anchors.drift[..., 0])
    beyond = anchors.displacements(np.array([1.0, 0.0, 0.0]))
    assert np.abs(beyond).max() < np.abs(anchors.drift[..., 0]).max(), "it was not measured from the very side"


@pytest.mark.parametrize(("right", "left"), [(33, 263), (61, 291), (98, 327)])
def test_drifts_mirror_each_other(right: int, left: int):
    anchors = open_head_anchors()
    rows = dict(zip(anchors.points.tolist(), anchors.drift, strict=True))
    mirrored = rows[left] * np.array([[-1, 1, 1]]).T * [-1, 1]
    np.testing.assert_allclose(rows[right], mirrored, atol=1e-3)


def test_points_that_are_where_the_network_sees_them_are_found_again():
    # A network that always means the same places of the surface: the table must name them, and give the true pose.
    anchors = open_head_anchors()
    truth = anchors.positions(MEAN, TRIANGLES)
    generator = np.random.default_rng(0)
    pictures = []
    for yaw in (-25.0, -10.0, 0.0, 10.0, 25.0):
        camera = look_at(np.array([0.0, 0.02, 0.06]), yaw, generator.uniform(-15, 15), 0.0, 1.0, 1200.0, 384)
        points = np.full((478, 3), -1000.0, np.float32)
        points[anchors.points, :2] = camera.project(torch.from_numpy(truth).float())[0].numpy()
        points[:, 2] = 0
        points[152] = points[10] + [0, 100, 0]  # the chin is no anchor, but tells where the face looks
        found = FaceLandmarks(points, np.ones(478, np.float32), 1.0, np.zeros(52, np.float32))
        pictures.append(Picture(MEAN, camera, found))
    table = find_anchors(MODEL, np.arange(478), pictures)  # each point its own partner: the midline alone is symmetric
    midline = np.flatnonzero(np.abs(truth[:, 0]) < 3e-4)
    for index in midline:
        (row,) = np.flatnonzero(table.points == anchors.points[index])
        place = table.barycentric[row] @ MEAN[TRIANGLES[table.faces[row]]]
        assert np.linalg.norm(place - truth[index]) < 5e-4
    turn, shift = pose_error(truth, anchors, pictures[0].found, pictures[0].camera)
    assert np.abs(turn).max() < 0.01
    assert np.abs(shift).max() < 2e-3


def test_a_painted_head_has_paint_where_it_belongs():
    camera = look_at(np.array([0.0, 0.02, 0.06]), 0.0, 0.0, 0.0, 1.0, 550.0, 160)
    look = Look.draw(np.random.default_rng(0))
    picture = HeadPainter(MODEL).draw(MEAN, camera, look)
    assert picture.shape == (160, 160, 3)
    pixels = camera.project(torch.from_numpy(MEAN[MODEL.landmarks68.numpy()]).float())[0].numpy()

    def colour(x: float, y: float) -> np.ndarray:
        return picture[int(y), int(x)].astype(float)

    brow, lip, cheek = colour(*pixels[19]), colour(*(pixels[57] - [0, 2])), colour(*((pixels[36] + pixels[48]) / 2))
    assert brow.sum() < 0.7 * cheek.sum()
    assert lip[1] / lip[0] < cheek[1] / cheek[0]
    np.testing.assert_allclose(picture[2, 2], 255 * look.background, atol=1)
