"""Faces at even times, and the pose and expression that a person starts from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filmed_faces import JAW, MARK, SIZE, KnownFaces, Performance, grey
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.animation.video_driver_expression import expression_hints, neutral_expression
from dynhair.animation.video_driver_faces import SeenFace, even_series, follow_face, usual_step
from dynhair.animation.video_driver_frames import TimedFrame
from dynhair.animation.video_driver_pose import (
    DEPTH,
    NEAREST,
    REACH,
    assumed_focal,
    bridged,
    gaps,
    held_near,
    rest_pose,
    seen_from,
)
from dynhair.face import open_head
from dynhair.preprocess.landmarks import BLENDSHAPE_NAMES
from dynhair.preprocess.tracking.head_motion import HeadMotion

NOSE = 1


def track(times: np.ndarray, unseen: tuple[int, ...] = ()) -> list[SeenFace]:
    faces = Performance.at(times).faces()
    return [
        SeenFace(float(t), None if i in unseen else face, SIZE)
        for i, (t, face) in enumerate(zip(times, faces, strict=True))
    ]


def motion(angles: np.ndarray, shifts: np.ndarray | None = None) -> HeadMotion:
    """A head that turns by angles in radians about the vertical."""
    rotations = Rotation.from_rotvec(angles[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    return HeadMotion(rotations, np.zeros((len(angles), 3)) if shifts is None else shifts, np.zeros((len(angles), 2)))


def angles_of(moved: HeadMotion) -> np.ndarray:
    return Rotation.from_matrix(moved.rotations).as_rotvec()[:, 1]


def test_even_films_are_taken_as_they_are() -> None:
    seen = track(2.0 + np.arange(6) / 24)
    series = even_series(seen)
    assert series is not None
    assert series.fps == pytest.approx(24)
    assert series.start == 2.0
    for index, frame in enumerate(seen):
        assert frame.face is not None
        np.testing.assert_allclose(series.points[index], frame.face.points, atol=1e-3)
    assert series.seen.all()


def test_uneven_films_are_interpolated_at_the_right_times() -> None:
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.03, 0.05, 40))
    series = even_series(track(times))
    assert series is not None
    even = series.start + np.arange(len(series.points)) / series.fps
    true = np.array([face.points for face in Performance.at(even).faces()])
    assert series.seen.all()
    np.testing.assert_allclose(series.points[:, NOSE, :2], true[:, NOSE, :2], atol=0.15)
    assert np.abs(np.diff(true[:, NOSE, 0])).max() > 0.5


def test_dropped_and_faceless_frames_are_missing_and_nothing_else() -> None:
    times = np.delete(np.arange(20) / 25, [5, 6, 7])
    series = even_series(track(times, unseen=(0, 10, 16)))
    assert series is not None
    assert series.start == pytest.approx(1 / 25)
    np.testing.assert_array_equal(np.flatnonzero(~series.seen) + 1, [5, 6, 7, 13])
    assert len(series.points) == 18
    assert np.isfinite(series.blendshapes).all()
    assert series.blendshapes[:, JAW].min() >= 0.2 - 1e-6


def test_faces_that_cannot_be_the_one_that_is_followed_are_left_out() -> None:
    times = np.arange(60) / 25
    faces = Performance.at(times).faces()
    middle = faces[0].points.mean(0)
    elsewhere = replace(faces[10], points=faces[10].points + np.array([40, 0, 0], np.float32))
    tiny = replace(faces[11], points=middle + (faces[11].points - middle) * np.float32(0.4))
    faces[10], faces[11] = elsewhere, tiny
    faces[20:] = [elsewhere] * 40  # the person was cut to another place
    frames = [TimedFrame(float(time), grey(MARK * index)) for index, time in enumerate(times)]
    found = np.array([seen.face is not None for seen in follow_face(frames, KnownFaces(faces))])
    assert not found[10:12].any()
    assert found[:10].all()
    assert found[12:20].all()
    assert not found[20:24].any()
    assert found[-10:].all()


def test_a_face_that_is_seen_once_is_no_series() -> None:
    assert even_series(track(np.arange(3) / 25, unseen=(0, 2))) is None


@given(st.floats(5, 240), st.integers(3, 200), st.sets(st.integers(1, 198), max_size=3))
def test_the_usual_step_is_that_between_frames_that_were_not_dropped(fps: float, count: int, dropped: set[int]) -> None:
    kept = [i for i in range(count) if i not in dropped or count < 12]
    assert usual_step(np.array(kept) / fps) == pytest.approx(1 / fps)


def test_a_head_is_never_taken_to_be_nearer_than_the_least() -> None:
    series = even_series(track(np.arange(4) / 25))
    assert series is not None
    assert assumed_focal(series, (10_000, 500)) == pytest.approx(10_000, rel=1e-3)
    # the performer's face is 90 cm away before a focal length of 160 pixels
    assert assumed_focal(series, (60, 100)) == pytest.approx(160 * NEAREST / 0.9, rel=0.05)


def rest_angle(angles: np.ndarray, camera: float = 0.0, known: np.ndarray | None = None, fps: float = 30.0) -> float:
    """Degrees of the rest pose of a head that turns by angles in degrees, filmed from an angle."""
    shown = motion(np.radians(angles - camera), np.tile([0.0, 0.0, -1.0], (len(angles), 1)))
    turn, _ = rest_pose(shown, np.ones(len(angles), bool) if known is None else known, fps)
    return Rotation.from_matrix(turn).as_rotvec(degrees=True)[1] + camera


def test_the_rest_pose_is_where_a_person_is_for_most_of_the_time() -> None:
    angles = np.r_[np.full(60, 0.2), np.linspace(0.2, 1.0, 10), np.full(30, 1.0)]
    places = angles[:, None] * [1.0, 0.0, 0.0] - [0.0, 0.0, 1.0]
    turn, place = rest_pose(motion(angles, places), np.ones(100, bool), 30.0)
    assert Rotation.from_matrix(turn).as_rotvec()[1] == pytest.approx(0.2, abs=0.02)
    assert place[0] == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("fps", [25.0, 60.0])
@pytest.mark.parametrize("swing", [20, 40])
def test_the_rest_pose_of_a_swing_is_its_middle(swing: float, fps: float) -> None:
    angles = swing * np.sin(2 * np.pi * 0.7 * np.arange(round(20 * fps / 7)) / fps)
    assert rest_angle(angles, fps=fps) == pytest.approx(0.0, abs=1)


@pytest.mark.parametrize("side", [-38.0, 38.0])
def test_a_look_aside_is_not_at_rest_though_it_is_held_twice_as_long(side: float) -> None:
    turning = np.linspace(0, side, 12)
    angles = np.r_[np.zeros(60), turning, np.full(120, side), turning[::-1]]
    tremble = np.random.default_rng(0).normal(0, 0.2, len(angles))
    assert abs(rest_angle(angles + tremble, camera=8.0)) < 5


def test_who_is_filmed_from_the_side_may_rest_there() -> None:
    angles = np.r_[np.zeros(90), 15 * np.sin(np.linspace(0, 6 * np.pi, 90))]
    assert abs(rest_angle(angles, camera=40.0)) < 2


def test_the_rest_pose_knows_nothing_of_what_was_not_seen() -> None:
    angles = np.r_[np.full(10, 0.3), np.full(90, 2.0)]
    turn, _ = rest_pose(motion(angles, np.tile([0.0, 0.0, -1.0], (100, 1))), np.arange(100) < 10, 30.0)
    assert Rotation.from_matrix(turn).as_rotvec()[1] == pytest.approx(0.3, abs=1e-6)


def test_gaps_are_bridged_without_overshoot_and_the_ends_are_held() -> None:
    known = np.ones(60, bool)
    known[:5] = known[20:40] = known[55:] = False
    true = np.linspace(0, 1.2, 60)
    wild = motion(np.where(known, true, 3.0), np.where(known, true, 9.0)[:, None] * [1.0, 0.0, 0.0])
    filled = bridged(wild, known)
    angles = angles_of(filled)
    np.testing.assert_allclose(angles[known], true[known], atol=1e-9)
    assert (np.diff(angles[5:55]) >= -1e-9).all()
    np.testing.assert_allclose(angles[:5], true[5], atol=1e-9)
    np.testing.assert_allclose(filled.translations[55:, 0], true[54], atol=1e-9)


def test_small_shifts_stay_and_large_ones_are_damped() -> None:
    origin = np.array([0.1, -0.2, -1.0])
    shifts = np.array([[0.01, 0, 0], [0, -0.02, 0], [0, 0, 0.01], [3.0, 4.0, 0], [0, 0, 0]])
    found = held_near(motion(np.zeros(5), origin + shifts), origin).translations - origin
    np.testing.assert_allclose(found[:3], shifts[:3] * [1, 1, DEPTH], rtol=0.02, atol=1e-12)
    np.testing.assert_allclose(found[3], REACH * np.array([0.6, 0.8, 0.0]), rtol=1e-6)
    np.testing.assert_array_equal(found[4], 0)


def test_another_origin_is_where_the_head_puts_it() -> None:
    moved = seen_from(motion(np.array([0.0, np.pi / 2])), np.array([0.0, 0.1, 0.2]))
    np.testing.assert_allclose(moved.translations, [[0, 0.1, 0.2], [0.2, 0.1, 0]], atol=1e-12)


def test_gaps_are_runs_of_unknown_frames() -> None:
    known = np.array([False, True, False, False, True, False])
    assert gaps(known) == [range(1), range(2, 4), range(5, 6)]
    assert gaps(np.ones(3, bool)) == []


def test_what_a_face_always_does_is_no_expression() -> None:
    blendshapes = np.full((40, 52), 0.3)
    smile = BLENDSHAPE_NAMES.index("mouthSmileLeft")
    blendshapes[10:, smile] = 0.9
    hints = expression_hints(open_head(), blendshapes)
    assert hints is not None
    names = open_head().expression_names
    np.testing.assert_allclose(hints[20, names.index("mouthSmileLeft")], 0.6)
    np.testing.assert_allclose(np.delete(hints, names.index("mouthSmileLeft"), axis=1), 0, atol=1e-12)
    np.testing.assert_array_equal(neutral_expression(open_head(), hints.astype(np.float32)), 0)


def test_components_that_no_network_judges_are_neutral_at_their_median() -> None:
    model = replace(open_head(), expression_range=(-3.0, 3.0), expression_names=tuple(map(str, range(52))))
    rng = np.random.default_rng(0)
    usual = rng.normal(size=52)
    expressions = np.tile(usual, (50, 1))
    expressions[:20] += 1.0
    assert expression_hints(model, np.full((50, 52), 0.3)) is None
    np.testing.assert_allclose(neutral_expression(model, expressions.astype(np.float32)), usual, atol=1e-6)
