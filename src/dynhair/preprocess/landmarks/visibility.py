"""Which landmarks the camera saw, and which the network guessed."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64

_HIDDEN, _SEEN = -0.2, 0.2  # cosines to the line of sight between which the visibility rises
_GUESS = 0.1  # visibility of hidden points, which are more than nothing: the network knows faces
_IRISES = ((range(468, 473), (33, 133, 159, 145)), (range(473, 478), (263, 362, 386, 374)))


def point_visibility(points: Float[np.ndarray, "478 3"], faces: Int64[np.ndarray, "f 3"]) -> Float[np.ndarray, " 478"]:
    """How far each landmark is seen rather than guessed, in [0, 1].

    The network gives all points of the face, those of a cheek that is turned away as well. What tells is the surface
    that the points themselves form: it is seen where it faces the camera. Irises count as the lids around them.

    On painted heads turned by 35 to 55 degrees, hidden points (cosine below -0.2) were 5.6 mm off in the median, those
    that face the camera 2.5 mm.

    Args:
        points: x right, y down and z away from the camera, in one unit.
        faces: triangles of the first 468 points, counter-clockwise seen from outside.
    """
    cosines = -vertex_normals(points[:468].astype(np.float64), faces)[:, 2]
    seen = np.clip((cosines - _HIDDEN) / (_SEEN - _HIDDEN), _GUESS, 1)
    visibility = np.zeros(len(points), np.float32)
    visibility[:468] = seen
    for iris, lids in _IRISES:
        visibility[iris] = seen[list(lids)].mean()
    return visibility


def vertex_normals(vertices: Float[np.ndarray, "v 3"], faces: Int64[np.ndarray, "f 3"]) -> Float[np.ndarray, "v 3"]:
    """Unit normals, weighted by area; of vertices without faces, nought."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.maximum(lengths, np.finfo(np.float64).tiny)
