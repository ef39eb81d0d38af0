"""The pull on hair, against a thrown stone and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.capture import HeadTrack
from dynhair.motion import motion_signals

GRAVITY = np.array([0.0, -9.81, 0.0])


def track(rotations: np.ndarray, translations: np.ndarray, fps: float) -> HeadTrack:
    expressions = np.zeros((len(rotations), 1), np.float32)
    return HeadTrack(rotations=rotations, translations=translations, expressions=expressions, fps=fps, gravity=GRAVITY)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_with_the_turns_it_accelerates_a_thrown_stone(seed: int) -> None:
    random = np.random.default_rng(seed)
    fps, middle = 1000.0, 20
    times = (np.arange(2 * middle + 1) - middle) / fps
    angles = 3 * np.outer(times, random.normal(size=3)) + 5 * np.outer(times**2, random.normal(size=3))
    rotations = Rotation.from_rotvec(angles).as_matrix()
    translations = np.outer(times, random.normal(size=3)) + 4 * np.outer(times**2, random.normal(size=3))
    # a thrown stone, in the world and in the head's frame
    stone = random.normal(size=3) * 0.2 + np.outer(times, random.normal(size=3)) + 0.5 * np.outer(times**2, GRAVITY)
    seen = np.einsum("tji,tj->ti", rotations, stone - translations)
    velocity = (seen[middle + 1] - seen[middle - 1]) * fps / 2
    acceleration = (seen[middle + 1] - 2 * seen[middle] + seen[middle - 1]) * fps**2
    signals = motion_signals(track(rotations, translations, fps))
    omega, alpha, pull = (part[middle].double().numpy() for part in (signals.omega, signals.alpha, signals.pull))
    turning = (
        np.cross(alpha, seen[middle]) + np.cross(omega, np.cross(omega, seen[middle])) + 2 * np.cross(omega, velocity)
    )
    np.testing.assert_allclose(pull - turning, acceleration, atol=2e-2)


def test_a_still_head_leaves_gravity() -> None:
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 2]).as_matrix()
    pull = motion_signals(track(np.stack([turn] * 4), np.ones((4, 3)), 30.0)).pull
    np.testing.assert_allclose(pull.numpy(), [[-9.81, 0.0, 0.0]] * 4, atol=1e-5)


@pytest.mark.parametrize(("frames", "forwards"), [(5, -2.0), (3, -2.0), (2, 0.0), (1, 0.0)])
def test_the_ends_have_their_neighbours_acceleration_and_two_frames_have_none(frames: int, forwards: float) -> None:
    translations = np.stack([np.arange(frames) ** 2 / 100.0, np.zeros(frames), np.zeros(frames)], 1)
    pull = motion_signals(track(np.stack([np.eye(3)] * frames), translations, 10.0)).pull
    np.testing.assert_allclose(pull.numpy(), [[forwards, -9.81, 0.0]] * frames, atol=1e-5)
