"""Landmarks of several views of one moment: points in space, and which views contradict the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from dynhair.camera import Camera
from dynhair.preprocess.landmarks.landmarker import FaceLandmarks, square_from_points
from dynhair.preprocess.landmarks.square import FaceSquare

_ROUNDS = 3
_SINGULAR = 1e-12  # determinant of the normal equations over the cube of their trace, below which rays are parallel
_MIN_SHARED = 30  # points that two views must both see to be compared
_SEEN = 0.3  # visibility from which a point counts as seen
_TOLERANCE = 0.03  # median distance of a view's points from the projected ones, over the side of the face's square
_SAME_FACE = 0.25  # likewise: faces that are none are a whole face off; cameras out of time or calibration, less


def triangulate(
    pixels: Float[np.ndarray, "v n 2"], weights: Float[np.ndarray, "v n"], projections: Float[np.ndarray, "v 3 4"]
) -> Float[np.ndarray, "n 3"]:
    """Points in space from their pixels in several views.

    Linear triangulation (Hartley and Zisserman, "Multiple View Geometry", section 12.2), repeated with the equations
    divided by the depths found before: the weighted sum of squared distances in pixels is then nearly the least.

    Args:
        pixels: of each point in each view.
        weights: how much each counts; 0 where it is missing.
        projections: ``K [R | t]``.

    Returns:
        The points in the world; nan where fewer than two views have a weight, or their rays are parallel.
    """
    pixels = np.where(weights[..., None] > 0, pixels, 0.0)
    rows = pixels[..., None] * projections[:, None, 2:] - projections[:, None, :2]  # (v, n, 2, 4)
    depths = np.ones(weights.shape)
    points = np.full((pixels.shape[1], 3), np.nan)
    enough = (weights > 0).sum(0) >= 2
    for _ in range(_ROUNDS):
        scaled = rows * (np.sqrt(weights) / depths)[..., None, None]
        left = np.moveaxis(scaled, 0, 1).reshape(len(points), -1, 4)
        normal = left[..., :3].swapaxes(1, 2) @ left
        size = np.trace(normal[..., :3], axis1=1, axis2=2)
        solvable = enough & (np.linalg.det(normal[..., :3]) > _SINGULAR * size**3)
        points[~solvable] = np.nan
        points[solvable] = -np.linalg.solve(normal[solvable, :, :3], normal[solvable, :, 3:])[..., 0]
        found = np.nan_to_num(points) @ projections[:, 2, :3].T + projections[:, 2, 3]
        depths = np.where(np.abs(found) > np.finfo(np.float64).eps, np.abs(found), 1.0).T
    return points


@dataclass(frozen=True)
class FaceInSpace:
    """MediaPipe's points of one moment in the world.

    Attributes:
        points: metres.
        known: which of them two views or more saw; the others are as the network guesses them.
    """

    points: Float[np.ndarray, "478 3"]
    known: Bool[np.ndarray, " 478"]

    @classmethod
    def triangulate(cls, faces: Sequence[FaceLandmarks], cameras: Sequence[Camera]) -> FaceInSpace:
        """The face that two views or more found.

        Args:
            faces: of one moment.
            cameras: the views.
        """
        visibility = np.array([face.visibility for face in faces], np.float64)
        points = triangulate(
            np.array([face.points[:, :2] for face in faces], np.float64),
            np.array([face.confidence for face in faces], np.float64),
            np.array([projection_matrix(camera) for camera in cameras]),
        )
        return cls(points, ((visibility > _SEEN).sum(0) >= 2) & ~np.isnan(points[:, 0]))

    def disagreement(self, face: FaceLandmarks, camera: Camera) -> float | None:
        """Median distance between known points and where a view saw them, over the side of the face's square.

        Returns:
            None if the view saw too few of them; infinity if most are behind the camera.
        """
        pixels, depths = project(self.points, camera)
        compared = self.known & (face.visibility > _SEEN)
        if compared.sum() < _MIN_SHARED:
            return None
        distances = np.linalg.norm(pixels - face.points[:, :2], axis=1)
        return float(np.median(np.where(depths > 0, distances, np.inf)[compared])) / face.square.side

    def agrees(self, face: FaceLandmarks, camera: Camera) -> bool:
        """Whether a view saw the face here."""
        distance = self.disagreement(face, camera)
        return distance is not None and distance < _TOLERANCE

    def is_near(self, face: FaceLandmarks, camera: Camera) -> bool:
        """Whether a view saw this face, though not quite here: its clock or its calibration may be wrong."""
        distance = self.disagreement(face, camera)
        return distance is not None and distance < _SAME_FACE

    def square(self, camera: Camera) -> FaceSquare | None:
        """Where a view should look for the face; None if it is behind the camera."""
        pixels, depths = project(self.points, camera)
        return square_from_points(pixels) if np.all(depths > 0) else None


def consistent_views(faces: Sequence[FaceLandmarks | None], cameras: Sequence[Camera]) -> Bool[np.ndarray, " v"]:
    """Which views to believe: the largest set of which each agrees with what two of them saw.

    A network that is shown hair may well see a face there, but not where other views see it. Views that share too few
    points to be compared are believed, unless others agree without them.

    Args:
        faces: of one moment; None where none was found.
        cameras: the views.
    """
    found = {view: face for view, face in enumerate(faces) if face is not None}
    best, best_distance = set[int](), np.inf
    contradicted = set[int]()
    for pair in combinations(found, 2):
        space = FaceInSpace.triangulate([found[view] for view in pair], [cameras[view] for view in pair])
        distances = {view: space.disagreement(face, cameras[view]) for view, face in found.items()}
        if any(distances[view] is None for view in pair):
            continue
        agreeing = {view: far for view, far in distances.items() if far is not None and far < _TOLERANCE}
        if not agreeing.keys() >= set(pair):
            contradicted.update(pair)
            continue
        distance = sum(agreeing.values()) / len(agreeing)
        if (len(agreeing), -distance) > (len(best), -best_distance):
            best, best_distance = set(agreeing), distance
    believed = best or found.keys() - contradicted
    return np.array([view in believed for view in range(len(faces))])


def project(
    points: Float[np.ndarray, "n 3"], camera: Camera
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """World points to pixels and depths in metres, in double precision."""
    local = np.c_[points, np.ones(len(points))] @ projection_matrix(camera).T
    depths = local[:, 2]
    return local[:, :2] / np.where(depths == 0, np.finfo(np.float64).eps, depths)[:, None], depths


def projection_matrix(camera: Camera) -> Float[np.ndarray, "3 4"]:
    """``K [R | t]`` in double precision."""
    return (camera.K.double() @ camera.w2c.double()).cpu().numpy()
