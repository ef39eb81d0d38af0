"""Where the points of a landmark detector lie on a face model's surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files

import numpy as np
from jaxtyping import Float, Int64


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
