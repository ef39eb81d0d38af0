from __future__ import annotations

import numpy as np

from dynhair.preprocess.landmarks import to_ibug68
from dynhair.preprocess.landmarks.ibug68 import IBUG68

JAW, BROWS, NOSE, EYES, MOUTH = range(17), range(17, 27), range(27, 36), range(36, 48), range(48, 68)
# iBUG's numbers of the mirrored landmarks
MIRRORED = (
    *reversed(JAW),
    *reversed(BROWS),
    *(27, 28, 29, 30, 35, 34, 33, 32, 31),
    *(45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40),
    *(54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55),
    *(64, 63, 62, 61, 60, 67, 66, 65),
)


def test_table_is_well_formed():
    assert len(IBUG68) == 68
    used = [point for means in IBUG68 for point in means]
    assert len(used) == len(set(used))
    assert min(used) >= 0
    assert max(used) < 468
    assert sorted(MIRRORED) == list(range(68))


def test_partners_are_partners_throughout():
    # What a point's partner is must not depend on where in the table the two stand.
    partner: dict[int, int] = {}
    for landmark, other in enumerate(MIRRORED):
        assert len(IBUG68[landmark]) == len(IBUG68[other])
        for one, two in zip(sorted(IBUG68[landmark]), sorted(IBUG68[other]), strict=True):
            if len(IBUG68[landmark]) == 1:
                assert partner.setdefault(one, two) == two


def test_landmarks_are_means():
    points = np.random.default_rng(0).normal(size=(478, 3))
    landmarks = to_ibug68(points)
    assert landmarks.shape == (68, 3)
    np.testing.assert_allclose(landmarks[36], points[33])
    np.testing.assert_allclose(landmarks[27], (points[168] + points[6]) / 2)
    np.testing.assert_allclose(to_ibug68(points[:, :2]), landmarks[:, :2])
