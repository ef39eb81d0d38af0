"""MediaPipe's points as the 68 landmarks of iBUG 300-W (Sagonas et al., 2013)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

# For each landmark the points whose mean it is, in iBUG's order: the person's right first. Every point of the left half
# is the mirror image of its partner in MediaPipe's canonical face.
_RIGHT_JAW = ((127,), (234,), (93, 132), (58,), (172,), (136,), (150, 149), (176,))
_LEFT_JAW = ((400,), (379, 378), (365,), (397,), (288,), (323, 361), (454,), (356,))
_RIGHT_BROW = ((70,), (63,), (105,), (66,), (107,))
_LEFT_BROW = ((336,), (296,), (334,), (293,), (300,))
_NOSE_BRIDGE = ((168, 6), (197,), (5,), (4, 1))
_NOSE_BASE = ((98,), (97,), (2,), (326,), (327,))
_RIGHT_EYE = ((33,), (160,), (158,), (133,), (153,), (144,))
_LEFT_EYE = ((362,), (385,), (387,), (263,), (373,), (380,))
_UPPER_LIP = ((61,), (40, 39), (37,), (0,), (267,), (269, 270), (291,))
_LOWER_LIP = ((321, 405), (314,), (17,), (84,), (181, 91))
_MOUTH = ((78,), (81,), (13,), (311,), (308,), (402,), (14,), (178,))

IBUG68 = (
    *(*_RIGHT_JAW, (152,), *_LEFT_JAW),
    *(*_RIGHT_BROW, *_LEFT_BROW),
    *(*_NOSE_BRIDGE, *_NOSE_BASE),
    *(*_RIGHT_EYE, *_LEFT_EYE),
    *(*_UPPER_LIP, *_LOWER_LIP, *_MOUTH),
)


def to_ibug68(points: Float[np.ndarray, "478 d"]) -> Float[np.ndarray, "68 d"]:
    """The landmarks of iBUG 300-W.

    Those of the jaw, 0 to 16, mean something else: iBUG's annotators marked the outline that the camera saw, which
    moves over the skin as the head turns; MediaPipe's face oval lies on the skin, here in nearly equal steps from the
    temple at the height of the eyes to the chin. The two agree where the face is seen from the front.

    Args:
        points: MediaPipe's, or any values that belong to them.
    """
    return np.stack([points[list(means)].mean(0) for means in IBUG68])
