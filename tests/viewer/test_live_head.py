from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from dynhair.motion import motion_signals
from dynhair.viewer.live_head import STIFFNESS, LiveHead

GRAVITY = np.array([0.0, -9.81, 0.0])
TURNED = Rotation.from_euler("y", 40, degrees=True).as_matrix()


def head(now: float = 0.0) -> LiveHead:
    return LiveHead(np.eye(3), np.zeros(3), fps=30.0, history=20, now=now)


def test_at_rest_nothing_is_due() -> None:
    live = head()
    live.advance(3.0)
    assert not live.moving
    assert live.wait(3.0) is None


def test_it_follows_a_step_like_a_critically_damped_spring() -> None:
    live, target = head(), np.array([0.1, -0.05, 0.02])
    live.aim(np.eye(3), target, 0.0)

    def spring(_: float, state: np.ndarray) -> np.ndarray:
        return np.r_[state[3:], -(STIFFNESS**2) * (state[:3] - target) - 2 * STIFFNESS * state[3:]]

    times = np.arange(1, 15) / 30
    exact = solve_ivp(spring, (0, 1), np.zeros(6), t_eval=times, rtol=1e-9, atol=1e-12).y[:3].T
    for time, place in zip(times, exact, strict=True):
        live.advance(float(time))
        np.testing.assert_allclose(live.pose[1], place, atol=1e-8)


def test_it_turns_about_one_axis_without_overshooting() -> None:
    live, angles = head(), []
    live.aim(TURNED, np.zeros(3), 0.0)
    for frame in range(1, 40):
        live.advance(frame / 30)
        turn = Rotation.from_matrix(live.pose[0]).as_rotvec(degrees=True)
        assert abs(turn[0]) + abs(turn[2]) < 1e-9
        angles.append(turn[1])
    assert np.all(np.diff(angles) > -1e-9)
    assert abs(angles[-1] - 40) < 0.01


def test_a_target_that_moves_on_does_not_make_the_head_jump() -> None:
    live = head()
    for event in range(30):
        live.aim(Rotation.from_euler("y", 3 * event, degrees=True).as_matrix(), np.zeros(3), event * 0.021)
    signals = motion_signals(live.track(np.zeros(2), GRAVITY))
    # the pointer's 3 degrees in an instant would be 90 degrees a frame; the head's own speed stays near the mean
    assert signals.omega.norm(dim=1).max() < np.radians(3 / 0.021) * 1.2
    assert signals.alpha.norm(dim=1).max() < np.radians(3 / 0.021) * STIFFNESS


@given(st.lists(st.floats(0.0, 0.3), min_size=1, max_size=20))
def test_how_often_it_is_looked_at_changes_nothing(pauses: list[float]) -> None:
    often, once, now = head(), head(), 0.0
    for live in (often, once):
        live.aim(TURNED, np.array([0.0, 0.1, 0.0]), 0.0)
    for pause in pauses:
        now = min(now + pause, 0.7)  # as long as no frame is left out
        often.advance(now)
    once.advance(now)
    np.testing.assert_allclose(often.pose[0], once.pose[0], atol=1e-12)
    assert often.steps == once.steps


def test_the_hair_is_given_time_to_settle_after_the_head_and_then_rest() -> None:
    live = head()
    live.aim(TURNED, np.zeros(3), 0.0)
    live.advance(1.0)
    wait = live.wait(1.0)
    assert live.moving
    assert wait is not None
    assert 0 <= wait < 1.001 / 30
    for frame in range(30, 90):
        live.advance(frame / 30)
    assert not live.moving
    np.testing.assert_allclose(live.pose[0], TURNED, atol=1e-9)
    assert float(motion_signals(live.track(np.zeros(2), GRAVITY)).omega.abs().max()) < 1e-6


def test_a_long_pause_costs_no_more_than_the_history() -> None:
    live = head()
    live.aim(TURNED, np.zeros(3), 0.0)
    live.advance(1e6)
    assert live.steps == len(live.track(np.zeros(2), GRAVITY).rotations)


def test_the_track_ends_now_and_is_as_long_as_the_hair_remembers() -> None:
    live = head()
    live.aim(TURNED, np.zeros(3), 0.0)
    live.advance(0.2)
    track = live.track(np.array([1.0, 2.0]), GRAVITY)
    assert len(track.rotations) == 24
    np.testing.assert_array_equal(track.rotations[-1], live.pose[0])
    np.testing.assert_array_equal(track.rotations[0], np.eye(3))
    np.testing.assert_array_equal(track.expressions, [[1.0, 2.0]] * 24)
