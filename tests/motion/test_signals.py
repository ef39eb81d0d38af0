"""Motion signals against closed forms and a plain reading of the paper's equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion import motion_signals

GRAVITY = (0.0, -9.81, 0.0)


def track(rotations: Rotation, fps: float = 30.0, gravity: tuple[float, float, float] = GRAVITY) -> HeadTrack:
    matrices = rotations.as_matrix()
    return HeadTrack(
        rotations=matrices,
        translations=np.zeros((len(matrices), 3)),
        expressions=np.zeros((len(matrices), 0), dtype=np.float32),
        fps=fps,
        gravity=np.array(gravity),
    )


def wandering(count: int, seed: int = 0) -> Rotation:
    """A smooth, generic rotation about a moving axis."""
    rng = np.random.default_rng(seed)
    time = np.arange(count)[:, None] / 30.0
    angles = sum(rng.normal(size=3) * np.sin(rng.uniform(1, 4) * time + rng.uniform(0, 6)) for _ in range(3))
    return Rotation.from_euler("yxz", np.asarray(angles))


def test_interior_frames_follow_the_paper() -> None:
    rotations, dt = wandering(12), 1 / 30.0
    signals = motion_signals(track(rotations))
    for t in range(2, 10):
        omega = {}
        for s in (t - 1, t, t + 1):
            omega[s] = (rotations[s + 1] * rotations[s - 1].inv()).as_rotvec() / (2 * dt)
        alpha = (omega[t + 1] - omega[t - 1]) / (2 * dt)
        np.testing.assert_allclose(signals.omega[t], rotations[t].inv().apply(omega[t]), rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(signals.alpha[t], rotations[t].inv().apply(alpha), rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(signals.gravity[t], rotations[t].inv().apply([0, -1, 0]), atol=1e-6)


def test_central_differences_converge_to_the_true_velocity_and_acceleration() -> None:
    """About a fixed axis the angle a(t) has omega = a' and alpha = a''; the error falls as the square of the step."""
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    errors = []
    for fps in (60.0, 120.0):
        time = np.arange(int(fps)) / fps
        signals = motion_signals(track(Rotation.from_rotvec(np.outer(np.sin(3 * time), axis)), fps=fps))
        omega, alpha = np.outer(3 * np.cos(3 * time), axis), np.outer(-9 * np.sin(3 * time), axis)
        inside = slice(2, -2)
        omega_error = np.abs(signals.omega.numpy() - omega)[inside].max()
        alpha_error = np.abs(signals.alpha.numpy() - alpha)[inside].max()
        errors.append([omega_error, alpha_error])
    ratio = np.array(errors[0]) / np.array(errors[1])
    assert (ratio > 3.5).all()


@pytest.mark.parametrize("fps", [24.0, 30.0, 59.94])
def test_constant_acceleration_is_exact_in_every_frame(fps: float) -> None:
    axis, acceleration = np.array([0.0, 0.6, 0.8]), 2.0
    time = np.arange(int(fps)) / fps
    signals = motion_signals(track(Rotation.from_rotvec(np.outer(acceleration * time**2 / 2, axis)), fps=fps))
    np.testing.assert_allclose(signals.alpha, np.tile(acceleration * axis, (len(time), 1)), atol=1e-4)
    np.testing.assert_allclose(signals.omega[1:-1], np.outer(acceleration * time, axis)[1:-1], atol=1e-5)


def test_one_frame_is_at_rest_and_two_frames_have_no_acceleration() -> None:
    one = motion_signals(track(wandering(1)))
    assert one.omega.abs().max() == 0
    assert one.alpha.abs().max() == 0
    turn = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]])
    two = motion_signals(track(turn))
    np.testing.assert_allclose(two.omega, [[0, 3, 0]] * 2, atol=1e-6)
    assert two.alpha.abs().max() == 0


@given(st.integers(0, 10_000))
def test_signals_do_not_depend_on_where_the_world_faces(seed: int) -> None:
    """Turning the whole world, gravity included, changes nothing in the head's frame."""
    turn = Rotation.from_rotvec(np.random.default_rng(seed).normal(size=3))
    motion = wandering(8, seed)
    here = motion_signals(track(motion))
    there = motion_signals(track(turn * motion, gravity=tuple(turn.apply(GRAVITY))))
    for name in ("omega", "alpha", "gravity"):
        torch.testing.assert_close(getattr(there, name), getattr(here, name), rtol=1e-4, atol=1e-4)


def test_gravity_is_a_direction_of_any_magnitude() -> None:
    motion = wandering(5)
    earth, moon = motion_signals(track(motion)), motion_signals(track(motion, gravity=(0.0, -1.62, 0.0)))
    torch.testing.assert_close(earth.gravity, moon.gravity)
    torch.testing.assert_close(earth.gravity.norm(dim=-1), torch.ones(5))


def test_signals_are_float32() -> None:
    signals = motion_signals(track(wandering(3)))
    assert signals.omega.dtype == signals.alpha.dtype == signals.gravity.dtype == torch.float32


def test_tracks_that_cannot_be_read() -> None:
    with pytest.raises(DynhairError, match="no direction"):
        motion_signals(track(wandering(3), gravity=(0.0, 0.0, 0.0)))
    with pytest.raises(DynhairError, match="frame rate"):
        motion_signals(track(wandering(3), fps=0.0))


def test_the_pose_is_told_in_the_world() -> None:
    rotations = wandering(6)
    moved = replace(track(rotations), translations=np.random.default_rng(0).normal(size=(6, 3)))
    signals = motion_signals(moved)
    np.testing.assert_allclose(signals.rotation, rotations.as_rotvec(), atol=1e-6)
    np.testing.assert_allclose(signals.translation, moved.translations, atol=1e-6)
