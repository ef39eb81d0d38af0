"""Find where MediaPipe's 478 face points lie on the open head, by showing pictures of the open head to the network.

Painted heads of many identities are drawn from many sides. Rays through the points found in each picture meet the
surface at places that are carried to the average head, where their centre is the anchor. How these places move with the
side that the picture was taken from is the anchor's drift. Both halves of the face are taken together, so that anchors
mirror each other. The table is then tried on heads that it was not made from: their
pose is solved from the points found, and compared with the true one.

    python -m tools.anchor_table src/dynhair/face/open_head_anchors.npz
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from scipy.optimize import least_squares
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from tools.head_renders import HeadPainter, Look, look_at
from tools.ray_cast import RayCaster
from tyro.conf import Positional

from dynhair.camera import Camera
from dynhair.face import FaceModel, open_head
from dynhair.face.anchors import Anchors
from dynhair.preprocess.landmarks.landmarker import FaceLandmarker, FaceLandmarks
from dynhair.preprocess.landmarks.networks import FaceMesh, FaceNetworks
from dynhair.storage import atomic_file

_SIZE = 384
_FACE = np.array([0.0, 0.02, 0.06])  # the middle of the face, metres from the head joint
_VIEW_ANGLES = np.array([38.0, 24.0, 10.0])  # largest yaw, pitch and roll, degrees
_DISTANCES = 0.6, 2.0
_FACE_PIXELS = 180, 300  # that 20 cm take
_FACING = 0.35  # least cosine between the line of sight and the normal where a ray counts
_MIN_SHARE = 0.25  # of the pictures that must show a point
_MAX_DEVIATION = 0.005
_DRIFT_DEVIATION = 0.01  # metres from the front to the side
_LEAST_DEVIATION = 0.002  # points of one picture stray together, so none counts as better than this
_RAYLEIGH_MEDIAN = np.sqrt(2 * np.log(2))  # median distance of a two-dimensional normal distribution


@dataclass(frozen=True)
class Picture:
    """What the network made of a picture of a head.

    Attributes:
        vertices: (V, 3) of the head, which is not turned.
        camera: the view.
        found: the landmarks.
    """

    vertices: np.ndarray
    camera: Camera
    found: FaceLandmarks


def anchor_table(out: Positional[Path], heads: int = 60, held_out: int = 20, views: int = 4, seed: int = 0) -> None:
    """Write the table and print how well it does on other heads.

    Args:
        out: The file to write.
        heads: How many identities to make it from, the first being the average head.
        held_out: How many identities to try it on.
        views: Pictures of each.
        seed: Of identities, looks and views.
    """
    torch.set_num_threads(1)
    model, networks = open_head(), FaceNetworks.load()
    generator = np.random.default_rng(seed)
    landmarker = FaceLandmarker(networks)
    pictures = list(draw_pictures(model, landmarker, heads, views, generator))
    anchors = find_anchors(model, mirrored_points(networks.mesh), pictures)
    with atomic_file(out) as temporary:
        np.savez_compressed(
            temporary,
            points=anchors.points.astype(np.int16),
            faces=anchors.faces.astype(np.int16),
            barycentric=anchors.barycentric.astype(np.float32),
            deviation=anchors.deviation.astype(np.float32),
            drift=anchors.drift.astype(np.float32),
        )
    print(f"{len(anchors.points)} anchors, median deviation {1e3 * np.median(anchors.deviation):.1f} mm")
    report_poses(model, anchors, list(draw_pictures(model, landmarker, held_out, views, generator)))


def draw_pictures(
    model: FaceModel, landmarker: FaceLandmarker, heads: int, views: int, generator: np.random.Generator
) -> Iterator[Picture]:
    """Pictures of heads in which the network found a face."""
    painter = HeadPainter(model)
    for head in range(heads):
        identity = generator.normal(size=len(model.identity_modes)).astype(np.float32) * (head > 0)
        vertices = model.vertices(torch.from_numpy(identity)).double().numpy()
        for _ in range(views):
            distance = generator.uniform(*_DISTANCES)
            focal = generator.uniform(*_FACE_PIXELS) * distance / 0.2
            yaw, pitch, roll = generator.uniform(-_VIEW_ANGLES, _VIEW_ANGLES)
            target = _FACE + generator.normal(scale=0.01, size=3)
            camera = look_at(target, yaw, pitch, roll, distance, focal, _SIZE)
            found = landmarker.detect(painter.draw(vertices, camera, Look.draw(generator)))
            if found is not None:
                yield Picture(vertices, camera, found)


def find_anchors(model: FaceModel, partners: np.ndarray, pictures: list[Picture]) -> Anchors:
    """The table: places on the average head, mirrored, that are seen often and stray little.

    Args:
        model: the heads'.
        partners: (478,) for each point, the one on the other half of the face.
        pictures: to learn from.
    """
    triangles, mean = model.faces.numpy(), model.mean.double().numpy()
    places = np.array([_places(picture, triangles, mean) for picture in pictures])  # (pictures, 478, 3)
    both = np.concatenate([places, places[:, partners] * [-1, 1, 1]])
    sights = np.array([sight(picture.camera)[:2] for picture in pictures])
    both_sights = np.concatenate([sights, sights * [-1, 1]])
    surface = _Surface(mean, triangles)
    rows = []
    for point in range(both.shape[1]):
        valid = ~np.isnan(both[:, point, 0])
        if valid.sum() < _MIN_SHARE * len(both):
            continue
        seen = both[valid, point]
        centre, drift = _drifting_median(seen, both_sights[valid])
        face, barycentric = surface.closest(centre)
        place = barycentric @ mean[triangles[face]] + both_sights[valid] @ drift.T
        deviation = float(np.median(np.linalg.norm(seen - place, axis=1)) / _RAYLEIGH_MEDIAN)
        if deviation < _MAX_DEVIATION:
            rows.append((point, face, barycentric, deviation, drift))
    return Anchors(*(np.array(column) for column in zip(*rows, strict=True)))


def sight(camera: Camera) -> np.ndarray:
    """The direction from the middle of a face that is not turned to the camera."""
    towards = camera.centre.double().numpy() - _FACE
    return towards / np.linalg.norm(towards)


def mirrored_points(mesh: FaceMesh) -> np.ndarray:
    """(478,) for each of MediaPipe's points, the one on the other half of the face."""
    partners = KDTree(mesh.vertices).query(mesh.vertices * [-1, 1, 1])[1]
    # an iris: centre, towards the person's right or left, up, the other side, down
    irises = np.array([473, 474, 475, 476, 477, 468, 469, 470, 471, 472])
    return np.concatenate([partners, irises])


def report_poses(model: FaceModel, anchors: Anchors, pictures: list[Picture]) -> None:
    """Print how far poses solved with the anchors on each head's true shape are from the truth."""
    triangles = model.faces.numpy()
    errors = []
    for picture in pictures:
        shape = anchors.positions(picture.vertices, triangles) + anchors.displacements(sight(picture.camera))
        errors.append(pose_error(shape, anchors, picture.found, picture.camera))
    turns, shifts = np.array(errors).swapaxes(0, 1)
    names = ("pitch", "yaw", "roll"), ("left", "up", "forward")
    for values, axes, unit in ((np.degrees(turns), names[0], "degrees"), (1e3 * shifts, names[1], "mm")):
        for name, value in zip(axes, values.T, strict=True):
            print(f"{name:>8}: mean {value.mean():6.2f}, deviation {value.std():5.2f} {unit}")
    print(f"{len(errors)} pictures")


def pose_error(
    shape: np.ndarray, anchors: Anchors, found: FaceLandmarks, camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vector, and displacement in metres of the middle of the face, of a head that did not move.

    Args:
        shape: (n, 3) the anchors on the head.
        anchors: the table.
        found: the landmarks.
        camera: the view.
    """
    w2c, intrinsics = camera.w2c.double().numpy(), camera.K.double().numpy()
    target = found.points[anchors.points, :2]
    deviation = np.maximum(anchors.deviation, _LEAST_DEVIATION)
    weights = (np.sqrt(found.confidence[anchors.points]) / deviation)[:, None]
    depth = w2c[2] @ np.append(_FACE, 1)
    weights *= depth / intrinsics[0, 0]  # a residual of 1 is one standard deviation

    def residuals(pose: np.ndarray) -> np.ndarray:
        moved = Rotation.from_rotvec(pose[:3]).apply(shape - _FACE) + _FACE + pose[3:]
        local = moved @ w2c[:, :3].T + w2c[:, 3]
        pixels = local @ intrinsics.T
        return (weights * (pixels[:, :2] / pixels[:, 2:] - target)).ravel()

    pose = least_squares(residuals, np.zeros(6), loss="soft_l1").x
    return pose[:3], pose[3:]


def _places(picture: Picture, triangles: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """(478, 3) where on the average head the points lie; nan where they miss the head or graze it."""
    caster = RayCaster(picture.vertices, triangles)
    faces, barycentric = caster.through_pixels(picture.camera, picture.found.points[:, :2].astype(np.float64))
    corners = picture.vertices[triangles[faces]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sight = picture.camera.centre.double().numpy() - corners.mean(1)
    cosines = (normals * sight).sum(1) / (np.linalg.norm(normals, axis=1) * np.linalg.norm(sight, axis=1))
    places = np.einsum("nc,ncd->nd", barycentric, mean[triangles[faces]])
    places[(faces < 0) | (cosines < _FACING)] = np.nan
    return places


def _drifting_median(points: np.ndarray, sights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The point seen from the front, and how it moves with the sight: least sum of distances (Weiszfeld's iteration).

    Args:
        points: (n, 3) metres.
        sights: (n, 2) x and y of the directions towards the camera.

    Returns:
        The point (3,), and its drift (3, 2), held back where few directions tell it.
    """
    columns = np.c_[np.ones(len(points)), sights]
    ridge = np.diag([0.0, 1.0, 1.0]) * (_LEAST_DEVIATION / _DRIFT_DEVIATION) ** 2
    answer = np.vstack([np.median(points, axis=0), np.zeros((2, 3))])
    for _ in range(50):
        weights = _LEAST_DEVIATION / np.maximum(np.linalg.norm(points - columns @ answer, axis=1), 1e-6)
        weighted = columns * weights[:, None]
        answer = np.linalg.solve(weighted.T @ columns + ridge, weighted.T @ points)
    return answer[0], answer[1:].T


class _Surface:
    """A mesh to find closest points on."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self._corners = vertices[triangles]
        self._centres = KDTree(self._corners.mean(1))

    def closest(self, point: np.ndarray, candidates: int = 24) -> tuple[int, np.ndarray]:
        """Triangle and barycentric coordinates of the surface's point closest to ``point``."""
        near = np.asarray(self._centres.query(point, candidates)[1])
        answers = [_closest_in_triangle(point, corners) for corners in self._corners[near]]
        found = np.einsum("tc,tcd->td", answers, self._corners[near])
        best = int(np.linalg.norm(found - point, axis=1).argmin())
        return int(near[best]), answers[best]


def _closest_in_triangle(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of a triangle's point closest to ``point``."""
    edges = corners[1:] - corners[0]
    along = np.linalg.lstsq(edges.T, point - corners[0], rcond=None)[0]
    inside = np.array([1 - along.sum(), *along])
    if inside.min() >= 0:
        return inside
    options = []
    for first, second in ((0, 1), (1, 2), (2, 0)):
        edge = corners[second] - corners[first]
        step = np.clip((point - corners[first]) @ edge / (edge @ edge), 0, 1)
        weights = np.zeros(3)
        weights[first], weights[second] = 1 - step, step
        options.append(weights)
    return min(options, key=lambda weights: float(np.linalg.norm(weights @ corners - point)))


if __name__ == "__main__":
    tyro.cli(anchor_table)
