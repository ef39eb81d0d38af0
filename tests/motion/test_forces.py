"""Forces in a moving head's frame, against free flight seen from it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion import head_forces

GRAVITY = np.array([0.0, -9.81, 0.0])


def track(rotations: np.ndarray, translations: np.ndarray, fps: float) -> HeadTrack:
    expressions = np.zeros((len(rotations), 1), np.float32)
    return HeadTrack(rotations=rotations, translations=translations, expressions=expressions, fps=fps, gravity=GRAVITY)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_free_flight_obeys_them(seed: int):
    random = np.random.default_rng(seed)
    fps, middle = 1000.0, 20
    times = (np.arange(2 * middle + 1) - middle) / fps
    axis, turning = random.normal(size=3), random.normal(size=3)
    angles = 3 * np.outer(times, axis) + 5 * np.outer(times**2, turning)
    rotations = Rotation.from_rotvec(angles).as_matrix()
    translations = np.outer(times, random.normal(size=3)) + 4 * np.outer(times**2, random.normal(size=3))
    # a thrown stone, in the world and in the head's frame
    stone = random.normal(size=3) * 0.2 + np.outer(times, random.normal(size=3)) + 0.5 * np.outer(times**2, GRAVITY)
    seen = np.einsum("tji,tj->ti", rotations, stone - translations)
    velocity = (seen[middle + 1] - seen[middle - 1]) * fps / 2
    acceleration = (seen[middle + 1] - 2 * seen[middle] + seen[middle - 1]) * fps**2
    forces = head_forces(track(rotations, translations, fps))[middle]
    found = forces.on(torch.from_numpy(seen[middle]).float(), torch.from_numpy(velocity).float())
    np.testing.assert_allclose(found.numpy(), acceleration, atol=2e-2)


def test_a_still_head_leaves_gravity():
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 2]).as_matrix()
    forces = head_forces(track(np.stack([turn] * 4), np.ones((4, 3)), 30.0))
    assert len(forces) == 4
    for frame in forces:
        np.testing.assert_allclose(frame.pull.numpy(), [-9.81, 0.0, 0.0], atol=1e-5)
        assert frame.omega.norm() == 0
        assert frame.alpha.norm() == 0


def test_the_ends_have_their_neighbours_acceleration():
    translations = np.stack([np.arange(5) ** 2 / 100.0, np.zeros(5), np.zeros(5)], 1)
    forces = head_forces(track(np.stack([np.eye(3)] * 5), translations, 10.0))
    for frame in forces:
        np.testing.assert_allclose(frame.pull.numpy(), [-2.0, -9.81, 0.0], atol=1e-5)


def test_two_frames_have_no_acceleration():
    short = track(np.stack([np.eye(3)] * 2), np.zeros((2, 3)), 30.0)
    with pytest.raises(DynhairError, match="2 frames has no accelerations"):
        head_forces(short)
