"""Sudden stops of a head, and how long damped hair takes to settle after them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.evaluation.settling import ARM, LEAST_TIP_SPEED, SETTLED, Stop, head_speeds, settling_time, sudden_stop

FPS = 30.0


def track(angles: np.ndarray, ways: np.ndarray | None = None, fps: float = FPS) -> HeadTrack:
    """Turns about a slanted axis by angles, and moves along x."""
    ways = np.zeros_like(angles) if ways is None else ways
    return HeadTrack(
        rotations=Rotation.from_rotvec(np.outer(angles, [0.0, 0.6, 0.8])).as_matrix(),
        translations=np.outer(ways, [1.0, 0.0, 0.0]),
        expressions=np.zeros((len(angles), 1), np.float32),
        fps=fps,
        gravity=np.array([0.0, -9.81, 0.0]),
    )


def turning(rates: list[float], fps: float = FPS) -> HeadTrack:
    """Of these angular velocities, rad/s, one after each frame."""
    return track(np.concatenate([[0.0], np.cumsum(rates)]) / fps, fps=fps)


def test_speed_of_the_head() -> None:
    speeds = head_speeds(track(0.1 * np.arange(4), 0.02 * np.arange(4)))
    assert math.isnan(speeds[0])
    np.testing.assert_allclose(speeds[1:], (0.02 + 0.1 * ARM) * FPS)


def test_a_stop_and_its_rest() -> None:
    assert sudden_stop(turning([0.0] * 5 + [4.0] * 10 + [0.0] * 20 + [2.0] * 5)) == Stop(16, 36)
    assert sudden_stop(turning([4.0] * 10 + [2.0, 1.0] + [0.0] * 20)) == Stop(13, 33)


def test_a_stop_of_a_head_that_only_moves() -> None:
    ways = np.concatenate([0.02 * np.arange(10), np.full(20, 0.18)])
    assert sudden_stop(track(np.zeros(30), ways)) == Stop(10, 30)


def test_the_first_of_several_stops_that_last() -> None:
    assert sudden_stop(turning([4.0] * 10 + [0.0] * 3 + [4.0] * 10 + [0.0] * 15 + [4.0] * 5 + [0.0] * 30)) == Stop(
        24, 39
    )


@pytest.mark.parametrize(
    "rates",
    [
        [0.0] * 60,
        [4.0] * 60,
        [0.5] * 30 + [0.0] * 30,  # too slow
        [*np.linspace(4.0, 0.0, 30).tolist(), *[0.0] * 30],  # gently
        [0.0] * 30 + [4.0] * 10,  # at rest before it has moved
        [4.0] * 10 + [0.0] * 10,  # not for long
        (4.0 * np.sin(np.arange(60) / 3)).tolist(),
        [],
    ],
)
def test_no_sudden_stop(rates: list[float]) -> None:
    assert sudden_stop(turning(rates)) is None


@given(st.floats(20.0, 120.0), st.floats(1.0, 6.0))
def test_the_frame_rate_does_not_matter(fps: float, rate: float) -> None:
    moving, resting = round(fps), round(0.7 * fps)
    stop = sudden_stop(turning([rate] * moving + [0.0] * resting, fps))
    if rate * ARM > 0.11:
        assert stop == Stop(moving + 1, moving + resting + 1)


@given(st.floats(2.0, 8.0), st.floats(0.05, 2.0))
def test_hair_that_slows_down_evenly_in_logarithm(decay: float, peak: float) -> None:
    times = np.arange(60) / FPS
    speeds = torch.from_numpy(np.concatenate([[math.nan] * 5, peak * np.exp(-decay * times)]))
    found = settling_time(speeds, Stop(5, 65), FPS)
    chord = decay / (8 * FPS**2)  # by which a chord crosses later than the curve below it, to first order
    assert found == pytest.approx(-math.log(SETTLED) / decay, abs=1.3 * chord)


def test_a_damped_oscillation_settles_after_its_last_large_swing() -> None:
    fps, decay, frequency = 1000.0, 1.5, 2.0
    times = np.arange(3000) / fps
    speeds = np.exp(-decay * times) * np.abs(np.cos(2 * np.pi * frequency * times))
    found = settling_time(torch.from_numpy(speeds), Stop(0, 3000), fps)
    fine = np.linspace(0.0, 3.0, 300_001)
    above = np.exp(-decay * fine) * np.abs(np.cos(2 * np.pi * frequency * fine)) >= SETTLED
    assert found == pytest.approx(fine[np.flatnonzero(above)[-1]], abs=1e-4)
    assert found is not None
    assert found > 0.2  # not at the first pass through zero


@given(st.floats(0.02, 50.0))
def test_only_shares_of_the_peak_count(size: float) -> None:
    speeds = torch.tensor([0.0, 1.0, 0.8, 0.6, 0.2, 0.3, 0.1]).double()
    found = settling_time(size * speeds, Stop(1, 7), 10.0)
    assert found == pytest.approx(0.225)


def test_motion_before_and_after_the_rest_does_not_count() -> None:
    speeds = torch.tensor([9.0, 9.0, 1.0, 0.4, 0.1, 0.1, 9.0, 9.0]).double()
    assert settling_time(speeds, Stop(2, 6), 10.0) == pytest.approx(0.1 * 0.5 / 0.6)


def test_hair_that_does_not_move_or_settle() -> None:
    still, restless = torch.full((20,), 0.9 * LEAST_TIP_SPEED), torch.full((20,), 0.5)
    assert settling_time(still.double(), Stop(3, 20), FPS) is None
    assert settling_time(restless.double(), Stop(3, 20), FPS) is None
    assert settling_time(restless.double(), Stop(20, 20), FPS) is None
    assert settling_time(torch.full((20,), math.nan).double(), Stop(3, 20), FPS) is None


def test_bad_input() -> None:
    with pytest.raises(DynhairError, match="frame rate"):
        head_speeds(replace(turning([1.0]), fps=0.0))
