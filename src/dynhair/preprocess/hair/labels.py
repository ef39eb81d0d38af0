"""Labels that a capture's own classifier can learn from: the face parser's where it is sure, and painted ones."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from dynhair.preprocess.hair.parser import PARTS, FaceParser
from dynhair.preprocess.landmarks.square import FaceSquare

UNKNOWN, HAIR, SKIN, CLOTHES, NOT_HAIR = range(5)
"""Labels of pixels; NOT_HAIR is anything but hair."""
LEAST_SCORE = 0.9
"""Of the landmarks, below which a view does not teach."""
LEAST_FACING = 0.4
"""See :func:`facing`: the parser's labels are good up to some 30 degrees of yaw."""
CROP_SCALES = (1.0, 1.2, 1.5)
"""The crops, in sides of the face square, and their mirror images have to agree on a label."""
LEAST_PROBABILITY = 0.7
_NOSE, _CHEEKS = 1, (234, 454)  # of the 478 landmarks
_LABEL_OF_PART = np.array([{"hair": HAIR, "skin": SKIN, "clothes": CLOTHES}.get(part, UNKNOWN) for part in PARTS])


@dataclass(frozen=True)
class TeachingView:
    """A view that may show the face well enough to learn from.

    Attributes:
        image: RGB.
        mask: coverage by the body, hair included.
        square: where the face is.
        score: of the landmarks, in [0, 1].
        points: the 478 landmarks in pixels (x and y first), where they are known.
    """

    image: UInt8[np.ndarray, "h w 3"]
    mask: UInt8[np.ndarray, "h w"]
    square: FaceSquare
    score: float
    points: Float32[np.ndarray, "478 d"] | None = None


@dataclass(frozen=True)
class PaintedView:
    """A view whose hair was painted by hand.

    Attributes:
        image: RGB.
        mask: coverage by the body, hair included.
        hair: coverage by hair.
    """

    image: UInt8[np.ndarray, "h w 3"]
    mask: UInt8[np.ndarray, "h w"]
    hair: UInt8[np.ndarray, "h w"]


def facing(points: Float32[np.ndarray, "478 d"]) -> float:
    """How far a face looks into the camera: the nose's distance to the near cheek over that to the far one, in [0, 1].

    It is 1 for a face seen from the front, about 0.4 at 30 degrees of yaw, and near 0 in profile.
    """
    near, far = sorted(np.linalg.norm(points[_NOSE, :2] - points[cheek, :2]) for cheek in _CHEEKS)
    return float(near / far) if far > 0 else 0.0


def faces_camera(view: TeachingView) -> bool:
    """Whether the landmarks say that the face is seen, and from the front."""
    return view.score >= LEAST_SCORE and (view.points is None or facing(view.points) >= LEAST_FACING)


def confident_labels(parser: FaceParser, view: TeachingView) -> UInt8[np.ndarray, "h w"] | None:
    """Labels of the pixels that the parser is sure of; the others are UNKNOWN.

    A pixel keeps its label where the parser says the same in several crops and their mirror images, with some
    probability, away from the border of the label by as much as the parser's grid is wide.

    Returns:
        HAIR, SKIN, CLOTHES or UNKNOWN; None where the parser did not find eyes, nose and mouth in every crop.
    """
    height, width = view.mask.shape
    total = np.zeros((height, width, len(PARTS)), np.float32)
    votes = []
    cell = 0.0
    for scale in CROP_SCALES:
        for mirrored in (False, True):
            parse = parser.parse(view.image, view.square, scale=scale, mirrored=mirrored)
            if not parse.shows_face:
                return None
            parts = parse.parts(height, width)
            total += parts
            inside = parts.sum(axis=-1)
            votes.append(np.where(inside > 0.99, parts.argmax(axis=-1), -1))
            cell = max(cell, float(np.hypot(*parse.to_image[:, 0])))
    weight = total.sum(axis=-1)
    best = total.argmax(axis=-1)
    agreed = np.all([(vote == best) | (vote < 0) for vote in votes], axis=0) & (weight > 1.99)
    sure = agreed & (total.max(axis=-1) > LEAST_PROBABILITY * weight) & (view.mask > 127)
    labels = np.where(sure, _LABEL_OF_PART[best], UNKNOWN).astype(np.uint8)
    return _erode(labels, max(1, round(cell)))


def painted_labels(view: PaintedView) -> UInt8[np.ndarray, "h w"]:
    """HAIR where the painter covered half a pixel or more, NOT_HAIR elsewhere on the body, UNKNOWN outside it."""
    return np.where(view.hair > 127, HAIR, np.where(view.mask > 127, NOT_HAIR, UNKNOWN)).astype(np.uint8)


def _erode(labels: UInt8[np.ndarray, "h w"], radius: int) -> UInt8[np.ndarray, "h w"]:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    # a pixel keeps its label where the whole disc carries it
    return np.where(cv2.erode(labels, disc) == cv2.dilate(labels, disc), labels, UNKNOWN).astype(np.uint8)
