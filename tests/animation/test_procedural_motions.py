"""Named motions: from rest, smooth, about the neck, and as large and fast as they say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import FPS, NEUTRAL, ORIGIN, REST, make_recording
from scipy.spatial.transform import Rotation

from dynhair.animation import MOTIONS, motion
from dynhair.animation.procedural import PIVOT, STILLNESS, SWEEP, SWEEP_RISE, SWEEP_STOP, WIND_UP
from dynhair.avatar import Recording
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError

FINE = 2000.0
AXES = {"nod": 0, "turn": 1, "shake": 1, "tilt": 2}
FREQUENCIES = {"nod": 0.8, "turn": 0.7, "shake": 1.8, "tilt": 0.75}


def finely(name: str, **options: float) -> np.ndarray:
    """The motion's rotation vectors relative to rest, 2,000 a second."""
    usual = make_recording()
    return vectors(motion(name, Recording(FINE, usual.gravity, usual.rest, usual.camera), **options))


def vectors(track: HeadTrack) -> np.ndarray:
    return Rotation.from_matrix(make_recording().rest.rotation.double().numpy().T @ track.rotations).as_rotvec()


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_begins_at_rest_in_the_rest_pose(name: str) -> None:
    track = motion(name, make_recording())
    np.testing.assert_allclose(track.rotations[0], REST, atol=1e-6)
    np.testing.assert_allclose(track.translations[0], ORIGIN, atol=1e-6)
    np.testing.assert_array_equal(track.expressions, np.tile(NEUTRAL, (len(track.rotations), 1)))
    assert track.fps == FPS
    fine = finely(name)
    assert np.linalg.norm(fine[1] * FINE) < 0.01  # rad/s
    acceleration = np.linalg.norm(np.diff(fine, n=2, axis=0), axis=1)
    assert acceleration[0] < 0.04 * acceleration.max()


@pytest.mark.parametrize("name", MOTIONS)
def test_angular_acceleration_has_no_jumps(name: str) -> None:
    """Halving the time step halves the largest change of the second difference."""
    fine = finely(name)

    def jump(step: int) -> float:
        second = np.diff(fine[::step], n=2, axis=0) * (FINE / step) ** 2
        return float(np.abs(np.diff(second, axis=0)).max())

    assert jump(2) < 0.65 * jump(4)
    assert jump(4) < 0.65 * jump(8)


@pytest.mark.parametrize("name", MOTIONS)
def test_the_neck_stays_where_it_is(name: str) -> None:
    track = motion(name, make_recording())
    neck = track.rotations @ PIVOT + track.translations
    np.testing.assert_allclose(neck, np.broadcast_to(neck[0], neck.shape), atol=1e-6)
    assert np.ptp(track.translations, axis=0).max() > 1e-3


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("speed", [1.0, 1.7])
def test_oscillations_have_the_axis_the_angle_and_the_peak_velocity_they_say(name: str, speed: float) -> None:
    amplitude = np.radians(12.0)
    found = finely(name, amplitude=12.0, speed=speed, seconds=6.0)
    axis = AXES[name]
    assert np.abs(np.delete(found, axis, axis=1)).max() < 1e-6
    np.testing.assert_allclose([found[:, axis].max(), -found[:, axis].min()], amplitude, rtol=1e-3)
    middle = slice(len(found) // 3, 2 * len(found) // 3)  # the amplitude has grown, and does not shrink yet
    velocity = np.gradient(found[:, axis], 1 / FINE)[middle]
    np.testing.assert_allclose(velocity.max(), amplitude * 2 * np.pi * FREQUENCIES[name] * speed, rtol=1e-3)


def test_a_figure_eight_crosses_its_middle_once_a_half_period() -> None:
    found = finely("figure-eight", amplitude=20.0, seconds=6.0)
    np.testing.assert_allclose(np.abs(found).max(axis=0), np.radians([10.0, 20.0, 0.0]), rtol=2e-2, atol=1e-6)
    plateau = np.arange(len(found) // 3, 2 * len(found) // 3)
    yaw, pitch = found[plateau, 1] / np.radians(20), found[plateau, 0] / np.radians(10)
    np.testing.assert_allclose(pitch**2, 4 * yaw**2 * (1 - yaw**2), atol=1e-5)  # Gerono's lemniscate


def test_stop_sweeps_at_its_peak_velocity_and_stands_still_within_a_moment() -> None:
    amplitude = np.radians(38.0)
    yaw = finely("stop")[:, 1]
    velocity = np.gradient(yaw, 1 / FINE)
    np.testing.assert_allclose([yaw.min(), yaw.max()], [-amplitude, amplitude], rtol=1e-6)
    peak = 2 * amplitude / (SWEEP * (1 - SWEEP_RISE / 2 - SWEEP_STOP / 2))
    np.testing.assert_allclose(velocity.max(), peak, rtol=1e-4)
    end = WIND_UP + SWEEP
    brakes = round((end - SWEEP * SWEEP_STOP) * FINE)
    np.testing.assert_allclose(velocity[brakes - 2], peak, rtol=1e-3)
    assert np.abs(yaw[round(end * FINE) :] - amplitude).max() < 1e-9
    assert len(yaw) / FINE - end == pytest.approx(STILLNESS, abs=2 / FINE)


def test_an_impulse_goes_there_and_back_at_its_peak_velocity() -> None:
    yaw = finely("impulse", amplitude=10.0, speed=2.0)[:, 1]
    half = 0.18 / 2
    np.testing.assert_allclose(yaw[round(half * FINE)], np.radians(10.0), rtol=1e-6)
    np.testing.assert_allclose(np.gradient(yaw, 1 / FINE).max(), np.radians(10.0) * 15 / 8 / half, rtol=1e-3)
    assert np.abs(yaw[round(2 * half * FINE) :]).max() < 1e-9


@given(
    name=st.sampled_from(MOTIONS),
    seconds=st.floats(0.05, 12.0),
    amplitude=st.floats(0.1, 80.0),
    speed=st.floats(0.2, 4.0),
)
def test_no_motion_exceeds_its_amplitude(name: str, seconds: float, amplitude: float, speed: float) -> None:
    track = motion(name, make_recording(), seconds=seconds, amplitude=amplitude, speed=speed)
    assert len(track.rotations) == max(2, round(seconds * FPS) + 1)
    limit = amplitude * (1.25 if name == "figure-eight" else 1.0)
    assert np.degrees(np.linalg.norm(vectors(track), axis=1)).max() <= limit + 1e-3


@pytest.mark.parametrize("options", [{"speed": 0.0}, {"amplitude": -3.0}, {"seconds": float("nan")}])
def test_options_that_make_no_motion_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(DynhairError, match="a positive number"):
        motion("nod", make_recording(), **options)


def test_a_name_that_is_none_is_refused_with_those_that_are() -> None:
    with pytest.raises(DynhairError, match="figure-eight"):
        motion("moonwalk", make_recording())
