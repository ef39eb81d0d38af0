"""Tracked heads against the heads that were shown to the cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from tracked_heads import (
    FPS,
    landmark_anchors,
    position_errors,
    rotation_errors,
    scene,
    smooth_motion,
    without,
)

from dynhair.errors import DynhairError
from dynhair.face import open_head
from dynhair.preprocess.tracking import Observations, TrackingOptions, TrackingResult, track_head
from dynhair.preprocess.tracking.anchored_head import AnchoredHead

MODEL = open_head()
ANCHORS = landmark_anchors(MODEL)


def track(observed: Observations, options: TrackingOptions | None = None) -> TrackingResult:
    return track_head([observed], MODEL, ANCHORS, options)


def test_the_motion_of_a_common_head() -> None:
    truth = scene(40, noise=1.0, outliers=0.2, unlike=0.0)
    observed = without(without(truth.observed, slice(0, 28, 7), slice(0, 2)), slice(30, 40), slice(2, 4))
    result = track(replace(observed, expression_hints=truth.motion.expressions))
    assert rotation_errors(result, truth.motion).mean() < 0.25
    assert position_errors(result, truth.motion).mean() < 1
    assert not result.takes[0].lost.any()


def test_a_detector_that_draws_turned_faces_to_the_camera_misleads_only_those_who_do_not_know() -> None:
    truth = scene(24, unlike=0.0)
    take, head = truth.observed, AnchoredHead.of(MODEL, ANCHORS)
    # each point goes where a head turned a tenth less would have it: x + 0.1 (sight_y, -sight_x, 0) x (x - centre)
    arms = head.mean - head.mean.mean(0)
    drift = 0.1 * np.stack([np.cross([0, 1, 0], arms), np.cross([-1, 0, 0], arms)], -1)
    biased = replace(ANCHORS, drift=drift)
    world = truth.motion.to_world(head.points(truth.person, truth.motion.expressions))
    seen = np.empty_like(take.points)
    for frame in range(take.frame_count):
        rotation = truth.motion.rotations[frame]
        for view in range(take.points.shape[1]):
            w2c, K = take.w2c[frame, view], take.K[frame, view]
            sight = (-w2c[:, :3].T @ w2c[:, 3] - world[frame].mean(0)) @ rotation
            sight /= np.linalg.norm(sight)
            moved = world[frame] + biased.displacements(sight) @ rotation.T
            pixels = (moved @ w2c[:, :3].T + w2c[:, 3]) @ K.T
            seen[frame, view] = pixels[:, :2] / pixels[:, 2:]
    observed = replace(take, points=seen, expression_hints=truth.motion.expressions)
    knowing = track_head([observed], MODEL, biased)
    ignorant = track_head([observed], MODEL, ANCHORS)
    assert rotation_errors(knowing, truth.motion).mean() < 0.25
    assert rotation_errors(ignorant, truth.motion).mean() > 4 * rotation_errors(knowing, truth.motion).mean()


@pytest.mark.slow
def test_the_motion_of_an_uncommon_head() -> None:
    """Which way an unknown skull faces is known to a degree; the same in all frames."""
    truth = scene(24, scale=0.9)
    result = track(truth.observed)
    errors = rotation_errors(result, truth.motion)
    assert errors.max() < 1.5
    assert np.ptp(errors) < 0.1
    assert position_errors(result, truth.motion).max() < 2


def test_vertices_and_landmarks_lie_where_the_true_head_is() -> None:
    truth = scene(8)
    result = track(truth.observed)
    expression = torch.from_numpy(truth.motion.expressions[5]).float()
    shape = MODEL.vertices(torch.from_numpy(truth.person.identity).float(), expression).numpy()
    world = shape @ truth.motion.rotations[5].T + truth.motion.translations[5]
    assert np.linalg.norm(result.landmarks_3d(0, 5) - world[MODEL.landmarks66.numpy()], axis=1).max() < 4e-3
    moving = MODEL.head_weight.numpy() == 1
    assert np.linalg.norm(result.vertices(0, 5) - world, axis=1)[moving].mean() < 5e-3


def test_shoulders_stay_while_the_head_turns() -> None:
    truth = scene(20)
    result = track(truth.observed)
    still = MODEL.head_weight.numpy() == 0
    assert still.any()
    shoulders = np.stack([result.vertices(0, frame)[still] for frame in (0, 7, 19)])
    assert np.ptp(shoulders, axis=0).max() < 1e-4


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_short_takes(frames: int) -> None:
    truth = scene(frames, noise=0.5)
    result = track(truth.observed)
    assert rotation_errors(result, truth.motion).max() < 3
    assert position_errors(result, truth.motion).max() < 10
    assert result.rotation_noise is None


@pytest.mark.slow
def test_one_camera() -> None:
    truth = scene(30, angles=(10.0,), noise=0.5)
    result = track(truth.observed)
    assert result.person.scale == 1
    assert rotation_errors(result, truth.motion).max() < 4
    assert position_errors(result, truth.motion).max() < 150  # along the line of sight: the head's size is a guess


def test_frames_without_a_face_are_bridged_and_called_lost() -> None:
    truth = scene(40, noise=0.5)
    result = track(without(truth.observed, slice(15, 20)))
    assert result.diagnostics.lost == ((range(15, 20),),)
    assert np.flatnonzero(result.takes[0].lost).tolist() == [15, 16, 17, 18, 19]
    assert rotation_errors(result, truth.motion).max() < 1
    lost_at_the_ends = track(without(without(truth.observed, slice(0, 3)), slice(38, 40)))
    assert np.isfinite(lost_at_the_ends.takes[0].motion.rotations).all()
    assert lost_at_the_ends.diagnostics.lost == ((range(3), range(38, 40)),)


@pytest.mark.slow
def test_takes_with_different_numbers_of_views_share_the_person() -> None:
    first, second = scene(10, noise=0.5, unlike=0.0), scene(12, (-20.0, 25.0), noise=0.5, unlike=0.0)
    # without hints a stranger's pitch would be known to two degrees only
    takes = [replace(seen.observed, expression_hints=seen.motion.expressions) for seen in (first, second)]
    result = track_head(takes, MODEL, ANCHORS)
    alone = replace(result, takes=result.takes[1:])
    assert rotation_errors(result, first.motion).max() < 0.6
    assert rotation_errors(alone, second.motion).max() < 0.6


@pytest.mark.slow
def test_a_swing_keeps_its_phase_and_amplitude() -> None:
    frames = 60
    truth = scene(frames, motion=smooth_motion(frames, len(MODEL.expression_modes), angle=0.4, hertz=2.0), noise=1.0)
    result = track(truth.observed)

    def yaw(rotations: np.ndarray) -> np.ndarray:
        angle = np.unwrap(np.arctan2(rotations[:, 0, 2], rotations[:, 2, 2]))
        return angle - angle.mean()

    true, found = yaw(truth.motion.rotations), yaw(result.takes[0].motion.rotations)
    assert abs(found @ true / (true @ true) - 1) < 0.02
    rate = np.gradient(true)
    lag = (true - found) @ rate / (rate @ rate)  # frames
    assert abs(lag) < 0.05


@pytest.mark.slow
def test_claimed_noise_is_the_true_noise() -> None:
    truth = scene(90, noise=2.0)
    result = track(truth.observed)
    noise = result.rotation_noise
    assert noise is not None

    def derivatives(rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        omega = Rotation.from_matrix(rotations[2:] @ rotations[:-2].swapaxes(-1, -2)).as_rotvec() * FPS / 2
        return omega, (omega[2:] - omega[:-2]) * FPS / 2

    true, found = derivatives(truth.motion.rotations), derivatives(result.takes[0].motion.rotations)
    omega, alpha = (float(np.sqrt(((a - b) ** 2).mean())) for a, b in zip(true, found, strict=True))
    assert 0.5 < noise.omega / omega < 2
    assert 0.5 < noise.alpha / alpha < 2


@pytest.mark.slow
def test_given_smoothness_is_used() -> None:
    truth = scene(30, noise=1.0)
    stiff = track(truth.observed, TrackingOptions(angular_jerk=0.01, linear_jerk=0.001))
    assert stiff.noise[0].angular_jerk == 0.01
    turns = np.degrees(Rotation.from_matrix(stiff.takes[0].motion.rotations).as_rotvec())
    assert np.abs(np.diff(turns, 3, axis=0)).max() < 0.01


@pytest.mark.slow
def test_hints_tell_expressions_that_landmarks_do_not() -> None:
    truth = scene(6, noise=0.5)
    hinted = track(replace(truth.observed, expression_hints=truth.motion.expressions))
    plain = track(truth.observed)
    errors = [np.abs(r.takes[0].motion.expressions - truth.motion.expressions).mean() for r in (hinted, plain)]
    assert errors[0] < 0.6 * errors[1]


@pytest.mark.slow
def test_masks_hold_the_head_in() -> None:
    truth = scene(6, noise=3.0)
    everywhere = track_head([truth.observed], MODEL, ANCHORS, masks=lambda *_: np.full((480, 640), 255, np.uint8))
    plain = track(truth.observed)
    np.testing.assert_allclose(everywhere.takes[0].motion.rotations, plain.takes[0].motion.rotations, atol=1e-6)


def test_progress_ends_at_the_total() -> None:
    steps: list[tuple[int, int]] = []
    track_head([scene(4).observed] * 2, MODEL, ANCHORS, progress=lambda done, total: steps.append((done, total)))
    assert [done for done, _ in steps] == list(range(1, len(steps) + 1))
    assert steps[-1] == (len(steps), len(steps))


def test_a_take_without_faces_is_named() -> None:
    good = scene(4).observed
    with pytest.raises(DynhairError, match="nod: no face was found"):
        track_head([good, replace(without(good), name="nod")], MODEL, ANCHORS)


def test_too_few_landmarks_for_the_anchors() -> None:
    good = scene(2).observed
    with pytest.raises(DynhairError, match="landmarks"):
        track(replace(good, points=good.points[:, :, :5], scores=good.scores[:, :, :5]))


def test_bad_observations() -> None:
    good = scene(2).observed
    with pytest.raises(DynhairError, match="frame rate"):
        replace(good, fps=0.0)
    with pytest.raises(DynhairError, match="not finite"):
        replace(good, points=np.full_like(good.points, np.nan))
