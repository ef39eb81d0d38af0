"""Cameras that are wrong are found out, and others are left in peace."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tracked_heads import landmark_anchors, scene, without

from dynhair.face import open_head
from dynhair.preprocess.tracking import Observations, TrackingResult, track_head, tracking_warnings

MODEL = open_head()
ANCHORS = landmark_anchors(MODEL)


def track(observed: Observations) -> TrackingResult:
    return track_head([observed], MODEL, ANCHORS)


@cache
def seen() -> Observations:
    return scene(45, noise=1.0).observed


@cache
def good() -> TrackingResult:
    return track(seen())


def test_nothing_is_wrong_with_good_cameras() -> None:
    assert tracking_warnings(good()) == []
    for camera in good().diagnostics.cameras:
        assert abs(camera.time_offset) < 0.05
        assert np.linalg.norm(camera.shift) < 0.5


def test_residuals_are_those_of_the_noise() -> None:
    residuals = good().diagnostics.median_residuals[0]
    assert residuals.shape == (45, 4)
    assert np.median(residuals) == pytest.approx(np.sqrt(2 * np.log(2)), rel=0.1)  # median of Rayleigh's distribution


@pytest.mark.parametrize("frames", [1, pytest.param(-1, marks=pytest.mark.slow)])
def test_a_camera_that_is_a_frame_off(frames: int) -> None:
    points = seen().points.copy()
    points[:, 2] = np.roll(points[:, 2], -frames, axis=0)
    result = track(without(replace(seen(), points=points), slice(-1, None) if frames > 0 else slice(0, 1), slice(2, 3)))
    found = [camera.time_offset for camera in result.diagnostics.cameras]
    assert found[2] == pytest.approx(frames, abs=0.3)
    assert np.abs(found[:2] + found[3:]).max() < 0.2
    (warning,) = tracking_warnings(result, ["a", "b", "c", "d"])
    assert (warning.kind, warning.camera) == ("synchronisation", 2)
    assert "camera c is" in warning.text
    assert ("late" if frames > 0 else "early") in warning.text


@pytest.mark.slow
def test_a_camera_that_looks_aside() -> None:
    points = seen().points.copy()
    points[:, 1] += [12.0, 4.0]
    result = track(replace(seen(), points=points))
    warnings = [w for w in tracking_warnings(result) if w.kind == "calibration"]
    assert [warning.camera for warning in warnings] == [1]
    np.testing.assert_allclose(result.diagnostics.cameras[1].shift, [12, 4], atol=1.5)


def test_lost_frames_are_told() -> None:
    result = track(without(without(seen(), slice(20, 24)), slice(40, 41)))
    several, one = tracking_warnings(result)
    assert (several.kind, several.take, several.frames) == ("lost", 0, range(20, 24))
    assert "frames 20 to 23" in several.text
    assert "frame 40" in one.text
    assert np.isnan(result.diagnostics.median_residuals[0][20:24]).all()


def test_a_camera_that_saw_nothing_and_a_head_at_rest() -> None:
    frame = scene(1, noise=0.5).observed
    points, scores, w2c, K = (np.repeat(a, 6, 0) for a in (frame.points, frame.scores, frame.w2c, frame.K))
    still = Observations(points, scores, w2c, K, None, 30.0)
    result = track(without(still, views=slice(3, 4)))
    assert tracking_warnings(result) == []
    assert result.diagnostics.cameras[3].face_size == 0
