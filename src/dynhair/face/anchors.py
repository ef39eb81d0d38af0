"""Where the points of a landmark detector lie on a face model's surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files

import numpy as np
from jaxtyping import Float, Int64

from dynhair.face.model import FaceModel

_LANDMARK_DEVIATION, _JAW_DEVIATION = 3e-3, 15e-3  # metres
_JAW, _CHIN = 17, 8


@dataclass(frozen=True)
class Anchors:
    """Places on the triangles of a face model, each of which is what one point of a landmark detector means.

    Attributes:
        points: indices of the detector's points, ascending.
        faces: indices of the model's triangles.
        barycentric: weights of the triangles' corners; their sum is 1.
        deviation: how far the detector strays along the surface from the place, standard deviation in metres.
    """

    points: Int64[np.ndarray, " n"]
    faces: Int64[np.ndarray, " n"]
    barycentric: Float[np.ndarray, "n 3"]
    deviation: Float[np.ndarray, " n"]

    def positions(
        self, vertices: Float[np.ndarray, "v 3"], triangles: Int64[np.ndarray, "f 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """The anchors on a head.

        Args:
            vertices: of the head.
            triangles: the model's, as vertex indices.
        """
        return np.einsum("nc,ncd->nd", self.barycentric, vertices[triangles[self.faces]])


@cache
def open_head_anchors() -> Anchors:
    """Where MediaPipe's 478 points lie on the open head; the same object each time, not to be changed.

    Points whose place varies from picture to picture by more than half a centimetre are left out.
    ``tools/anchor_table.py`` made the table.
    """
    with (
        as_file(files("dynhair.face") / "open_head_anchors.npz") as path,
        np.load(path, allow_pickle=False) as arrays,
    ):
        return Anchors(
            points=arrays["points"].astype(np.int64),
            faces=arrays["faces"].astype(np.int64),
            barycentric=arrays["barycentric"].astype(np.float64),
            deviation=arrays["deviation"].astype(np.float64),
        )


def landmark68_anchors(model: FaceModel) -> Anchors:
    """Where the iBUG-68 landmarks lie on a face model: on its vertices, in iBUG's order.

    Those of the jaw count for little: where along the face's outline they lie is a matter of convention.

    Args:
        model: any that knows its landmarks.
    """
    vertices, triangles = model.landmarks68.numpy(), model.faces.numpy()
    flat = triangles.ravel()
    order = np.argsort(flat, kind="stable")
    corners = order[np.searchsorted(flat[order], vertices)]  # a corner of some triangle at each vertex
    deviation = np.full(len(vertices), _LANDMARK_DEVIATION)
    deviation[:_CHIN] = deviation[_CHIN + 1 : _JAW] = _JAW_DEVIATION
    return Anchors(
        points=np.arange(len(vertices)), faces=corners // 3, barycentric=np.eye(3)[corners % 3], deviation=deviation
    )
