"""Jitter goes, the motion stays, and nothing comes later than it was."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from recordings import smooth_motion
from scipy.spatial.transform import Rotation

from dynhair.animation import resampled, smoothed
from dynhair.animation.smoothing import CUTOFF
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion import motion_signals

FPS, EDGE = 30.0, 8


def clean(seconds: float = 6.0) -> HeadTrack:
    return resampled(smooth_motion(np.arange(round(seconds * FPS)) / FPS), FPS)


def jittered(track: HeadTrack, degrees: float) -> HeadTrack:
    generator = np.random.default_rng(5)
    noise = Rotation.from_rotvec(np.radians(degrees) * generator.normal(size=(len(track.rotations), 3))).as_matrix()
    return dataclasses.replace(track, rotations=noise @ track.rotations)


def error(track: HeadTrack, truth: HeadTrack, name: str) -> float:
    """Root mean square of a signal's error."""
    own, true = (getattr(motion_signals(each), name).numpy()[EDGE:-EDGE] for each in (track, truth))
    return float(np.sqrt(((own - true) ** 2).sum(axis=1).mean()))


def test_a_third_of_the_accelerations_noise_remains() -> None:
    truth = dataclasses.replace(clean(), rotations=np.tile(np.eye(3), (180, 1, 1)))
    noisy = jittered(truth, 0.3)
    assert error(smoothed(noisy), truth, "alpha") < 0.36 * error(noisy, truth, "alpha")
    assert error(smoothed(noisy), truth, "omega") < 0.5 * error(noisy, truth, "omega")


def test_a_clean_motion_is_hardly_changed() -> None:
    """By less than 2 % of the largest velocity and acceleration, at up to 2 Hz, root mean square."""
    truth = clean()
    for name, most in (("omega", 0.02), ("alpha", 0.02)):
        largest = float(getattr(motion_signals(truth), name).norm(dim=1).max())
        assert error(smoothed(truth), truth, name) < most * largest


@pytest.mark.parametrize("frequency", [0.5, 1.0, 3.0, 5.0])
def test_there_is_no_lag_and_the_amplitude_is_the_filters(frequency: float) -> None:
    times = np.arange(300) / FPS
    angle = 0.2 * np.sin(2 * np.pi * frequency * times)
    track = dataclasses.replace(clean(10.0), rotations=Rotation.from_rotvec(angle[:, None] * [0, 1.0, 0]).as_matrix())
    found = Rotation.from_matrix(smoothed(track).rotations).as_rotvec()[:, 1]
    inside = slice(60, -60)
    carrier = np.exp(-2j * np.pi * frequency * times[inside])
    gain = (found[inside] * carrier).sum() / (angle[inside] * carrier).sum()
    assert abs(np.angle(gain)) < 2e-3
    assert abs(gain) == pytest.approx(1 / (1 + np.tan(np.pi * frequency / FPS) ** 4 / np.tan(np.pi / 6) ** 4), rel=1e-2)
    assert CUTOFF / FPS == 1 / 6


def test_the_result_does_not_depend_on_the_worlds_axes_or_on_the_heads() -> None:
    track = jittered(clean(), 1.0)
    generator = np.random.default_rng(7)
    left, right = Rotation.random(2, rng=generator).as_matrix()
    turned = dataclasses.replace(track, rotations=left @ track.rotations @ right)
    np.testing.assert_allclose(smoothed(turned).rotations, left @ smoothed(track).rotations @ right, atol=1e-9)


def test_steady_rotation_and_translation_pass_unchanged_through_half_turns() -> None:
    times = np.arange(200) / FPS
    steady = dataclasses.replace(
        clean(),
        rotations=Rotation.from_rotvec(times[:, None] * [0, 3.0, 0]).as_matrix(),
        translations=times[:, None] * [0.1, 0.0, -0.2],
        expressions=np.zeros((200, 3), np.float32),
    )
    found = smoothed(steady)
    np.testing.assert_allclose(found.rotations, steady.rotations, atol=1e-6)
    np.testing.assert_allclose(found.translations, steady.translations, atol=1e-6)


def test_expressions_stay_and_a_cutoff_beyond_the_frame_rate_does_nothing() -> None:
    track = jittered(clean(), 1.0)
    assert smoothed(track, 15.0) is track
    np.testing.assert_array_equal(smoothed(track).expressions, track.expressions)
    with pytest.raises(DynhairError, match="above 0"):
        smoothed(track, 0.0)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_short_tracks_pass(count: int) -> None:
    track = clean()
    short = dataclasses.replace(
        track,
        rotations=track.rotations[:count],
        translations=track.translations[:count],
        expressions=track.expressions[:count],
    )
    np.testing.assert_allclose(smoothed(short).rotations[0], short.rotations[0], atol=0.1)
