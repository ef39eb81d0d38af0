"""Landmarks of a face in an image: MediaPipe's Face Landmarker (Lugaresi et al., 2019; Kartynnik et al., 2019)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from scipy.special import expit

from dynhair.preprocess.landmarks.blendshapes import BLENDSHAPE_POINTS
from dynhair.preprocess.landmarks.detector import search_faces
from dynhair.preprocess.landmarks.networks import CROP_SIZE, FaceNetworks
from dynhair.preprocess.landmarks.square import FaceSquare, square_around
from dynhair.preprocess.landmarks.visibility import point_visibility

MIN_SCORE = 0.5
_ROUNDS = 3  # of cropping around the points found before
_RIGHT_EYE, _LEFT_EYE = 33, 263  # outer corners
_FOREHEAD, _CHIN = 10, 152
_PROFILE, _FRONT = 0.3, 0.85  # cosines of the face to the line of sight between which confidence rises
_LEAST = 0.05


@dataclass(frozen=True)
class FaceLandmarks:
    """A face that was found in an image.

    Attributes:
        points: x and y in pixels, pixel centres at (i + 0.5, j + 0.5); z in pixels as well, smaller nearer to the
            camera, known up to a shift. The first 468 are MediaPipe's face mesh, the last ten the irises, the person's
            right one first.
        visibility: how far each point is seen rather than guessed, in [0, 1].
        score: how surely there is a face, in [0, 1].
        blendshapes: strengths of the facial actions ``BLENDSHAPE_NAMES``, in [0, 1].
    """

    points: Float[np.ndarray, "478 3"]
    visibility: Float[np.ndarray, " 478"]
    score: float
    blendshapes: Float[np.ndarray, " 52"]

    @property
    def facing(self) -> float:
        """Cosine of the angle between the face and the line of sight: 1 from the front, 0 in profile."""
        points = self.points.astype(np.float64)
        normal = np.cross(points[_LEFT_EYE] - points[_RIGHT_EYE], points[_CHIN] - points[_FOREHEAD])
        return float(normal[2] / np.linalg.norm(normal))

    @property
    def confidence(self) -> Float[np.ndarray, " 478"]:
        """How much each point should count, in [0, 1]: its visibility, less in a face that is turned away or unsure.

        The network turns faces towards the camera: on painted heads its points were off by 1.5 times as much as from
        the front at 35 to 55 degrees, and the head's pose solved from them by 3 degrees; beyond that by 2.5 times and 8
        degrees.
        """
        facing = np.clip((self.facing - _PROFILE) / (_FRONT - _PROFILE), 0, 1)
        return (self.visibility * self.score * max(facing, _LEAST)).astype(np.float32)

    @property
    def square(self) -> FaceSquare:
        """The square around the face."""
        return square_from_points(self.points[:, :2])


class FaceLandmarker:
    """Finds the face of an image and its landmarks. One thread may use it at a time.

    Args:
        networks: MediaPipe's, from the cache, by default.
    """

    def __init__(self, networks: FaceNetworks | None = None) -> None:
        self._networks = networks or FaceNetworks.load()

    def detect(self, image: UInt8[np.ndarray, "h w 3"], hint: FaceSquare | None = None) -> FaceLandmarks | None:
        """The landmarks of the face, or None where there is none to be seen.

        Args:
            image: one person's picture; where there are several faces, one that is large.
            hint: where the face should be, say from the frame before; elsewhere it is looked for only if it is not
                there.
        """
        for square in self._candidates(image, hint):
            found = self.detect_at(image, square)
            if found is not None:
                return found
        return None

    def detect_at(self, image: UInt8[np.ndarray, "h w 3"], square: FaceSquare) -> FaceLandmarks | None:
        """The landmarks of the face near ``square``, or None where there is none to be seen."""
        points, score = np.empty(0), 0.0
        for _ in range(_ROUNDS):
            points, score = self._locate(image, square)
            if score < MIN_SCORE:
                return None
            square = square_from_points(points[:, :2])
        return FaceLandmarks(
            points=points,
            visibility=point_visibility(points, self._networks.mesh.faces),
            score=score,
            blendshapes=self._networks.blendshapes(points[BLENDSHAPE_POINTS, :2]),
        )

    def _candidates(self, image: UInt8[np.ndarray, "h w 3"], hint: FaceSquare | None) -> Iterator[FaceSquare]:
        if hint is not None:
            yield hint
        for box in search_faces(self._networks.boxes, image):
            yield box.square

    def _locate(self, image: UInt8[np.ndarray, "h w 3"], square: FaceSquare) -> tuple[np.ndarray, float]:
        crop = square.crop(image, CROP_SIZE).astype(np.float32) / 255
        local, logit = self._networks.points(crop)
        local = local.astype(np.float64) / CROP_SIZE
        points = np.c_[square.to_image(local[:, :2]), local[:, 2] * square.side]
        return points.astype(np.float32), float(expit(logit))


def square_from_points(points: Float[np.ndarray, "478 2"]) -> FaceSquare:
    """The square to look for a face in of which all points are roughly known, for instance projected from elsewhere."""
    return square_around(points.astype(np.float64), _RIGHT_EYE, _LEFT_EYE)
