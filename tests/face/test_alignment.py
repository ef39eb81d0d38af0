from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dynhair.face import open_head
from dynhair.face.alignment import aligned_to_face
from dynhair.face.registration import closest_similarity

FACE = np.arange(12)


@pytest.fixture
def mean() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(40, 3))


def test_a_mode_that_is_a_small_motion_vanishes_and_growth_stays(mean: np.ndarray) -> None:
    turn, shift = np.array([0.3, -0.2, 0.5]), np.array([0.4, 0.1, -0.7])
    mode = np.cross(turn, mean) + shift
    assert np.abs(aligned_to_face(mode[None], mean, FACE)).max() < 1e-12
    growth = 0.1 * (mean - mean[FACE].mean(0))
    assert np.allclose(aligned_to_face(growth[None] + mode, mean, FACE)[0], growth, atol=1e-12)


def test_what_a_mode_does_beyond_a_motion_stays(mean: np.ndarray) -> None:
    modes = np.random.default_rng(1).normal(size=(3, 40, 3))
    aligned = aligned_to_face(modes, mean, FACE)
    for mode, left in zip(modes, aligned, strict=True):
        taken = mode - left
        # a small motion of all vertices, and none of what is left
        assert np.allclose(aligned_to_face(taken[None], mean, FACE), 0, atol=1e-12)
        assert np.allclose(aligned_to_face(left[None], mean, FACE)[0], left, atol=1e-12)


def test_identities_of_the_open_head_do_not_turn_the_face() -> None:
    head = open_head()
    face = head.landmarks68.numpy()[17:]
    mean = head.mean.double().numpy()
    for mode in head.identity_modes.double().numpy():
        _, rotation, _ = closest_similarity(mean[face], (mean + 0.2 * mode)[face])
        assert np.degrees(Rotation.from_matrix(rotation).magnitude()) < 0.05
        assert np.linalg.norm(mode[face].mean(0)) < 1e-6
