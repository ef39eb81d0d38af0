"""Avatars driven by films: the head that moved is the head that was filmed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from filmed_faces import KnownFaces, Performance, write_marked_film
from recordings import NEUTRAL, ORIGIN, REST, make_recording
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from dynhair.animation import video_driver
from dynhair.animation.video_driver import track_of_video
from dynhair.capture import ExpressionBasis, HeadTrack
from dynhair.errors import DynhairError

BLINDED = range(20, 24)
ARKIT = ExpressionBasis("another", ("cheer", "jawOpen", "eyeBlinkLeft"))


def avatar_of(basis: ExpressionBasis | None) -> Any:
    return SimpleNamespace(expression_basis=basis)


@dataclass(frozen=True)
class Driven:
    """A film's motion and the avatar's."""

    shown: Performance
    track: HeadTrack
    notes: list[str]
    hints: list[Any]

    @property
    def turned(self) -> np.ndarray:
        """The avatar's rotation vectors from rest, degrees, at the film's times."""
        vectors = Rotation.from_matrix(REST.T @ self.track.rotations).as_rotvec(degrees=True)
        return self._at_film_times(vectors)

    @property
    def moved(self) -> np.ndarray:
        """The avatar's shifts from rest in the head's resting frame, metres, at the film's times."""
        return self._at_film_times((self.track.translations - ORIGIN) @ REST)

    def _at_film_times(self, values: np.ndarray) -> np.ndarray:
        return CubicSpline(np.arange(len(values)) / self.track.fps, values)(self.shown.times - self.shown.times[0])


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """A film of 2 s at an uneven rate, noisy, with frames in which the face is not found."""
    rng = np.random.default_rng(1)
    times = 0.5 + np.cumsum(rng.uniform(0.03, 0.05, 52))
    shown = Performance.at(np.round(times, 3))
    faces = [None if index in BLINDED else face for index, face in enumerate(shown.faces(noise=0.1))]
    landmarker, notes = KnownFaces(faces), []
    path = write_marked_film(tmp_path_factory.mktemp("film") / "film.mp4", shown.times.tolist())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(video_driver, "_LANDMARKS", 30)
        track = track_of_video(path, make_recording(), avatar_of(ARKIT), landmarker=landmarker, note=notes.append)
    return Driven(shown, track, notes, landmarker.hints)


def test_the_avatar_turns_as_the_person_does_at_the_same_time(driven: Driven) -> None:
    shown = Rotation.from_matrix(driven.shown.rotations).as_rotvec(degrees=True)
    for axis, error in enumerate((2.0, 2.0, 1.5)):
        found = driven.turned[:, axis]
        slope, _ = np.polyfit(shown[:, axis], found, 1)
        assert 0.85 < slope < 1.15
        assert np.abs((found - shown[:, axis]) - np.median(found - shown[:, axis])).mean() < error
    lags = np.arange(-0.1, 0.11, 0.01)
    yaw = CubicSpline(driven.shown.times, driven.turned[:, 1])
    middle = driven.shown.times[8:-8]
    likeness = [np.corrcoef(shown[8:-8, 1], yaw(middle + lag))[0, 1] for lag in lags]
    assert abs(lags[int(np.argmax(likeness))]) < 0.015


def test_the_avatar_moves_as_the_person_does_in_metres(driven: Driven) -> None:
    centre = driven.shown.translations + driven.shown.rotations @ [0.0, 0.044, 0.013]
    slope, _ = np.polyfit(centre[:, 0], driven.moved[:, 0], 1)
    assert 0.6 < slope < 1.1
    assert np.linalg.norm(driven.moved, axis=1).max() < 0.1


def test_the_track_is_the_avatars_own(driven: Driven) -> None:
    duration = driven.shown.times[-1] - driven.shown.times[0]
    assert driven.track.fps == make_recording().fps
    assert len(driven.track.rotations) == pytest.approx(duration * driven.track.fps, abs=2)
    np.testing.assert_array_equal(driven.track.gravity, make_recording().gravity)
    assert driven.track.expression_basis == ARKIT


def test_expressions_are_counted_from_the_persons_neutral_face_and_carried_by_name(driven: Driven) -> None:
    expressions = driven.track.expressions
    np.testing.assert_allclose(expressions[:, 0], NEUTRAL[0], atol=1e-6)
    jaw = CubicSpline(np.arange(len(expressions)) / driven.track.fps, expressions[:, 1])
    found = jaw(driven.shown.times - driven.shown.times[0])
    assert np.corrcoef(found, driven.shown.jaw)[0, 1] > 0.97
    assert found.max() - found.min() == pytest.approx(np.ptp(driven.shown.jaw), rel=0.3)


def test_the_face_is_looked_for_where_it_was_last_seen(driven: Driven) -> None:
    assert driven.hints[0] is None
    assert driven.hints[BLINDED.start] is not None
    assert all(driven.hints[index] == driven.hints[BLINDED.start] for index in (*BLINDED, BLINDED.stop))


def test_the_share_of_found_faces_is_told(driven: Driven) -> None:
    assert driven.notes[0] == "film.mp4: the face was found in 92.3% of 52 frames"


def test_a_film_without_a_face_is_refused(tmp_path: Path) -> None:
    path = write_marked_film(tmp_path / "empty.mp4", [0.0, 0.04, 0.08])
    with pytest.raises(DynhairError, match="found in 0 of 3 frames"):
        track_of_video(path, make_recording(), avatar_of(None), landmarker=KnownFaces([None] * 3))


def test_times_that_jump_are_refused(tmp_path: Path) -> None:
    path = write_marked_film(tmp_path / "jump.mp4", [0.0, 0.04, 0.08, 3600.0])
    faces = Performance.at(np.arange(4) / 25).faces()
    with pytest.raises(DynhairError, match="4 frames are shown over 3600 s"):
        track_of_video(path, make_recording(), avatar_of(None), landmarker=KnownFaces(faces))


def test_a_picture_is_no_film(tmp_path: Path) -> None:
    path = write_marked_film(tmp_path / "one.mp4", [0.0])
    faces = Performance.at(np.zeros(1)).faces()
    with pytest.raises(DynhairError, match="found in 1 of 1 frames"):
        track_of_video(path, make_recording(), avatar_of(None), landmarker=KnownFaces(faces))


@pytest.mark.slow
def test_long_gaps_are_told_and_bridged_and_the_ends_held(tmp_path: Path) -> None:
    times = np.arange(40) / 10
    shown = Performance.at(times)
    unseen = {0, 1, 2, *range(15, 25), 38, 39}
    faces = [None if index in unseen else face for index, face in enumerate(shown.faces())]
    path, notes = write_marked_film(tmp_path / "gaps.mp4", times.tolist()), []
    landmarker = KnownFaces(faces)
    track = track_of_video(path, make_recording(), avatar_of(None), landmarker=landmarker, note=notes.append)
    assert "no face is to be seen from 1.5 s to 2.5 s" in "\n".join(notes)
    assert len(track.rotations) == pytest.approx(3.9 * track.fps, abs=2)
    np.testing.assert_allclose(track.translations[:8], track.translations[[0] * 8], atol=2e-3)
    steps = np.linalg.norm(np.diff(track.translations, axis=0), axis=1)
    assert steps.max() < 0.02
