"""Motion at other rates: the hair hears the same velocities and accelerations."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from recordings import smooth_motion
from scipy.spatial.transform import Rotation

from dynhair.animation import RestPose, TimedMotion, resampled
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion import MotionSignals, motion_signals

SECONDS = 3.0
EDGE = 8
"""Frames at either end that are looked at apart: nothing is known of the motion beyond it."""


def signals_of(motion: TimedMotion, fps: float = 30.0) -> MotionSignals:
    return motion_signals(resampled(motion, fps))


def at_rate(rate: float) -> TimedMotion:
    return smooth_motion(np.arange(round(SECONDS * rate) + 1) / rate)


@pytest.mark.parametrize("rate", [24.0, 25.0, 29.97, 48.0, 60.0, 120.0, 240.0])
def test_velocity_and_acceleration_do_not_depend_on_the_rate(rate: float) -> None:
    """Within 1 % of the largest velocity and 2 % of the largest acceleration; 10 and 30 % at the ends."""
    truth, found = signals_of(at_rate(30.0)), signals_of(at_rate(rate))
    count = min(len(truth.omega), len(found.omega))
    for name, inside, ends in (("omega", 0.01, 0.1), ("alpha", 0.02, 0.3)):
        true, own = (getattr(signals, name).numpy()[:count] for signals in (truth, found))
        error = np.linalg.norm(own - true, axis=1) / np.linalg.norm(true, axis=1).max()
        assert error[EDGE:-EDGE].max() < inside
        assert error.max() < ends


@pytest.mark.parametrize("rate", [24.0, 60.0, 120.0])
def test_poses_are_those_of_the_motion(rate: float) -> None:
    truth, found = resampled(at_rate(30.0), 30.0), resampled(at_rate(rate), 30.0)
    turn = Rotation.from_matrix(truth.rotations.transpose(0, 2, 1) @ found.rotations[: len(truth.rotations)])
    assert np.degrees(turn.magnitude()).max() < 0.2
    np.testing.assert_allclose(found.translations, truth.translations, atol=5e-4)
    np.testing.assert_allclose(found.expressions, truth.expressions, atol=0.02)


def test_irregular_instants_are_no_matter() -> None:
    generator = np.random.default_rng(3)
    times = np.cumsum(generator.uniform(0.5, 1.5, 150)) / 50 + 17.0
    truth = smooth_motion(times[0] + np.arange(int((times[-1] - times[0]) * 30) + 1) / 30)
    found, true = resampled(smooth_motion(times), 30.0), resampled(truth, 30.0)
    assert len(found.rotations) == len(true.rotations)
    turn = Rotation.from_matrix(true.rotations.transpose(0, 2, 1) @ found.rotations)
    assert np.degrees(turn.magnitude())[EDGE:-EDGE].max() < 0.3


@pytest.mark.parametrize("frequency", [22.0, 31.0, 55.0, 110.0])
def test_what_is_too_fast_for_the_frame_rate_does_not_come_back_as_slow_motion(frequency: float) -> None:
    times = np.arange(720) / 240
    shiver = np.radians(0.5) * np.sin(2 * np.pi * frequency * times)
    motion = still(times)
    motion = dataclasses.replace(motion, rotations=Rotation.from_rotvec(shiver[:, None] * [0, 1.0, 0]).as_matrix())
    fake = motion_signals(
        HeadTrack(motion.rotations[::8], motion.translations[::8], motion.expressions[::8], 30.0, motion.gravity)
    )
    found = signals_of(motion)
    inside = slice(EDGE, -EDGE)
    assert found.alpha[inside].norm(dim=1).max() < 0.03 * fake.alpha[inside].norm(dim=1).max()


def test_a_motion_of_the_frame_rate_is_left_as_it_is() -> None:
    motion = at_rate(30.0)
    track = resampled(motion, 30.0)
    np.testing.assert_array_equal(track.rotations, motion.rotations)
    assert resampled(track, 30.0) == track


def test_a_constant_rotation_stays_constant() -> None:
    times = np.arange(121) / 120
    turning = Rotation.from_rotvec(times[:, None] * np.array([1.0, 2.0, -2.0])).as_matrix()
    omega = signals_of(dataclasses.replace(still(times), rotations=turning)).omega.numpy()
    np.testing.assert_allclose(omega, np.broadcast_to([1.0, 2.0, -2.0], omega.shape), atol=1e-3)


def test_expressions_do_not_overshoot() -> None:
    times = np.arange(25) / 24
    blink = (np.arange(25) == 12).astype(np.float32)[:, None]
    expressions = resampled(dataclasses.replace(still(times), expressions=blink), 30.0).expressions
    assert expressions.min() >= 0
    assert expressions.max() <= 1


@pytest.mark.parametrize("count", [2, 3, 5])
def test_short_motions_are_resampled_too(count: int) -> None:
    for rate in (10.0, 100.0):
        track = resampled(still(np.arange(count) / rate), 30.0)
        assert len(track.rotations) == int((count - 1) / rate * 30 + 1e-4) + 1


def test_a_single_instant_is_no_motion() -> None:
    with pytest.raises(DynhairError, match="single instant"):
        resampled(still(np.zeros(1)), 30.0)
    with pytest.raises(DynhairError, match="frame rate"):
        resampled(at_rate(24.0), 0.0)


def still(times: np.ndarray) -> TimedMotion:
    count = len(times)
    return TimedMotion(
        times=times,
        rotations=np.tile(np.eye(3), (count, 1, 1)),
        translations=np.zeros((count, 3)),
        expressions=np.zeros((count, 1), np.float32),
        rest=RestPose(np.eye(3), np.zeros(3), np.zeros(1, np.float32)),
        gravity=np.array([0.0, -9.81, 0.0]),
    )
