"""Where the points of a landmark detector lie on a face model's surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files

import numpy as np
from jaxtyping import Float, Int64

_WIDEST_SIGHT = np.array([0.6, 0.4])  # x and y to which the drift was measured


@dataclass(frozen=True)
class Anchors:
    """Places on the triangles of a face model, each of which is what one point of a landmark detector means.

    Attributes:
        points: indices of the detector's points, ascending.
        faces: indices of the model's triangles.
        barycentric: weights of the triangles' corners; their sum is 1.
        deviation: how far the detector strays from the place, standard deviation in metres.
        drift: metres by which the detector puts a point elsewhere on the head for each unit of x and y of the direction
            from the face to the camera, in the head's frame. A detector draws turned faces towards the camera.
    """

    points: Int64[np.ndarray, " n"]
    faces: Int64[np.ndarray, " n"]
    barycentric: Float[np.ndarray, "n 3"]
    deviation: Float[np.ndarray, " n"]
    drift: Float[np.ndarray, "n 3 2"]

    def positions(
        self, vertices: Float[np.ndarray, "v 3"], triangles: Int64[np.ndarray, "f 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """The anchors on a head.

        Args:
            vertices: of the head.
            triangles: the model's, as vertex indices.
        """
        return np.einsum("nc,ncd->nd", self.barycentric, vertices[triangles[self.faces]])

    def displacements(self, sight: Float[np.ndarray, "*v 3"]) -> Float[np.ndarray, "*v n 3"]:
        """How far from its anchor the detector puts each point, metres in the head's frame.

        Args:
            sight: unit directions from the face to the camera, in the head's frame.
        """
        sideways = np.clip(sight[..., :2], -_WIDEST_SIGHT, _WIDEST_SIGHT)
        return np.einsum("ndk,...k->...nd", self.drift, sideways)

    def at(self, chosen: Int64[np.ndarray, " m"]) -> Anchors:
        """Some of the anchors."""
        return Anchors(
            self.points[chosen],
            self.faces[chosen],
            self.barycentric[chosen],
            self.deviation[chosen],
            self.drift[chosen],
        )


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
            drift=arrays["drift"].astype(np.float64),
        )
