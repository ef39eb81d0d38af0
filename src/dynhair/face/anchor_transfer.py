"""Where the points of the landmark detector lie on any face model."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64
from scipy.spatial import KDTree

from dynhair.face.anchors import Anchors, open_head_anchors
from dynhair.face.model import FaceModel
from dynhair.face.open_head import open_head
from dynhair.face.registration import register

_TRANSFER_ERROR = 3e-3  # standard deviation along the surface, metres
_CANDIDATES = 12  # vertices around which to look for the nearest triangle


def face_anchors(model: FaceModel) -> Anchors:
    """The anchors of a model: the open head's own table, or that table carried over.

    To carry it over, the open head is registered to the model's average head, by 66 landmarks; each anchor goes to the
    nearest place on a triangle that looks the same way. Its deviation grows by what the registration leaves between
    the landmarks.
    """
    head, table = open_head(), open_head_anchors()
    if model is head:
        return table
    registered = register(model.mean[model.landmarks66]).vertices().double().numpy()
    triangles, own = head.faces.numpy(), model.faces.numpy()
    vertices = model.mean.double().numpy()
    faces, barycentric = _nearest(
        table.positions(registered, triangles), _normals(registered[triangles[table.faces]]), vertices, own
    )
    return Anchors(table.points, faces, barycentric, np.hypot(table.deviation, _TRANSFER_ERROR), table.drift)


def _nearest(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int64[np.ndarray, "f 3"],
) -> tuple[Int64[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """The triangle nearest to each point among those that look the same way, and where on it."""
    used = np.unique(faces)
    _, neighbours = KDTree(vertices[used]).query(points, k=min(_CANDIDATES, len(used)))
    chosen, weights = [], []
    for point, normal, near in zip(points, normals, used[neighbours], strict=True):
        candidates = np.flatnonzero(np.isin(faces, near).any(1))
        alike = candidates[_normals(vertices[faces[candidates]]) @ normal > 0.5]
        candidates = alike if len(alike) else candidates
        barycentric = _closest_on_triangles(point, vertices[faces[candidates]])
        places = np.einsum("nc,ncd->nd", barycentric, vertices[faces[candidates]])
        best = int(np.linalg.norm(places - point, axis=1).argmin())
        chosen.append(candidates[best])
        weights.append(barycentric[best])
    return np.array(chosen), np.array(weights)


def _closest_on_triangles(
    point: Float[np.ndarray, " 3"], corners: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "n 3"]:
    """Barycentric coordinates of the place on each triangle that is closest to the point.

    It is the foot of the perpendicular where that lies within, else the closest place on one of the three edges.
    """
    a, b, c = corners.swapaxes(0, 1)
    edges = np.stack([b - a, c - a], axis=2)
    two = (np.linalg.pinv(edges) @ (point - a)[:, :, None])[:, :, 0]
    places = [np.column_stack([1 - two.sum(1), two])]
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge, arm = corners[:, end] - corners[:, start], point - corners[:, start]
        along = np.clip((edge * arm).sum(1) / np.maximum((edge**2).sum(1), 1e-30), 0, 1)
        place = np.zeros((len(corners), 3))
        place[:, start], place[:, end] = 1 - along, along
        places.append(place)
    options = np.stack(places, axis=1)  # (n, 4, 3)
    distances = np.linalg.norm(np.einsum("noc,ncd->nod", options, corners) - point, axis=2)
    distances[(options < 0).any(2)] = np.inf
    return options[np.arange(len(corners)), distances.argmin(1)]


def _normals(corners: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    a, b, c = corners.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
