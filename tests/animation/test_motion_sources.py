"""What drives an avatar: which kind a specification is, and where another head's motion goes."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from recordings import FPS, NEUTRAL, ORIGIN, REST, make_recording, smooth_motion
from scipy.spatial.transform import Rotation

from dynhair.animation import MOTIONS, RestPose, TimedMotion, driving_track, segment_motion, write_motion
from dynhair.animation.capture_names import own_capture
from dynhair.animation.expressions import carried_expressions
from dynhair.animation.sources import names_segment
from dynhair.avatar import Avatar
from dynhair.capture import Capture, ExpressionBasis, HeadTrack
from dynhair.errors import DynhairError
from dynhair.presets import preset
from dynhair.training import capture_recording
from dynhair.training.run import Run
from synthetic import write_synthetic_capture

BASIS = ExpressionBasis("Anny", ("jawOpen", "eyeBlinkLeft", "mouthSmile_R"))


def head(basis: ExpressionBasis | None = None) -> Avatar:
    """As much of an avatar as its drivers ask for."""
    return cast(Avatar, SimpleNamespace(expression_basis=basis))


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    path = tmp_path_factory.mktemp("captures") / "person"
    return Capture.open(write_synthetic_capture(path, frames=5, views=1, size=24, motions=("turn:train", "wave:test")))


@pytest.mark.parametrize("name", ["turn", "wave"])
def test_a_segment_of_the_own_capture_drives_as_it_is(capture: Capture, name: str) -> None:
    found = driving_track(f"{capture.path}:{name}", capture_recording(capture), head())
    track = capture.track(capture.segment(name))
    np.testing.assert_allclose(found.rotations, track.rotations, atol=1e-6)
    np.testing.assert_allclose(found.translations, track.translations, atol=1e-6)
    np.testing.assert_allclose(found.expressions, track.expressions, atol=1e-6)
    assert found.fps == capture.fps


def test_a_capture_that_is_given_comes_before_motions_by_name(capture: Capture) -> None:
    recording = capture_recording(capture)
    given = driving_track("turn", recording, head(), capture=capture.path)
    assert len(given.rotations) == 5
    assert len(driving_track("turn", recording, head()).rotations) > 5
    assert len(driving_track("nod", recording, head(), capture=capture.path, seconds=1.0).rotations) == 11


def test_another_heads_motion_starts_from_the_own_rest(capture: Capture) -> None:
    """At the avatar's rate, in its world, with its gravity; relative poses are the driver's."""
    recording = make_recording(expressions=3)
    driver = segment_motion(capture, "wave")
    spoken: list[str] = []
    found = driving_track(f"{capture.path}:wave", recording, head(), note=spoken.append)
    assert found.fps == FPS
    assert len(found.rotations) == int(driver.times[-1] * FPS + 1e-4) + 1
    np.testing.assert_allclose(found.rotations[0], REST, atol=1e-5)
    np.testing.assert_allclose(found.translations[0], ORIGIN, atol=1e-5)
    relative = driver.rest.rotation.T @ driver.rotations
    np.testing.assert_allclose(REST.T @ found.rotations[::3], relative, atol=1e-5)
    np.testing.assert_array_equal(found.gravity, recording.gravity)
    np.testing.assert_array_equal(found.expressions, np.tile(NEUTRAL, (len(found.rotations), 1)))
    assert spoken == ["the expression stays neutral: the driver has 4 coefficients, the avatar 3"]


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".json"])
def test_a_segment_goes_through_a_file_unchanged(capture: Capture, tmp_path: Path, suffix: str) -> None:
    recording, path = capture_recording(capture), tmp_path / f"wave{suffix}"
    write_motion(path, segment_motion(capture, "wave"))
    direct, filed = (driving_track(spec, recording, head()) for spec in (f"{capture.path}:wave", path))
    for name in ("rotations", "translations", "expressions"):
        np.testing.assert_allclose(getattr(filed, name), getattr(direct, name), atol=1e-6)


def test_motions_are_smoothed_where_it_is_asked_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    noise = Rotation.from_rotvec(0.02 * generator.normal(size=(60, 3))).as_matrix()
    still = np.zeros((60, 3))
    jitter = HeadTrack(noise, still, still.astype(np.float32), FPS, np.array([0, -9.81, 0]))

    def track_of_video(path: Path, *others: Any, **options: Any) -> HeadTrack:
        return jitter

    monkeypatch.setattr("dynhair.animation.video_driver.track_of_video", track_of_video)

    def shaking(track: HeadTrack) -> float:
        return float(np.abs(np.diff(Rotation.from_matrix(track.rotations).as_rotvec(), n=2, axis=0)).mean())

    recording = make_recording()
    assert driving_track("me.MOV", recording, head()) is jitter
    assert shaking(driving_track("me.MOV", recording, head(), smoothing=5.0)) < 0.2 * shaking(jitter)
    assert len(driving_track("me.MOV", recording, head(), seconds=1.0).rotations) == 31
    write_motion(tmp_path / "me.npz", jitter)
    filed = driving_track(tmp_path / "me.npz", recording, head())
    assert shaking(filed) == pytest.approx(shaking(jitter), rel=0.05)
    assert shaking(driving_track(tmp_path / "me.npz", recording, head(), smoothing=5.0)) < 0.2 * shaking(jitter)
    with pytest.raises(DynhairError, match="a smoothing of -1"):
        driving_track("me.MOV", recording, head(), smoothing=-1.0)


def test_what_means_nothing_is_refused_with_all_that_would(capture: Capture) -> None:
    recording = make_recording()
    with pytest.raises(DynhairError, match="figure-eight") as caught:
        driving_track("moonwalk", recording, head(), capture=capture.path)
    assert "turn, wave" in str(caught.value)
    with pytest.raises(DynhairError, match="no segment is called `jump`"):
        driving_track(f"{capture.path}:jump", recording, head())
    with pytest.raises(DynhairError, match="no such file"):
        driving_track("missing.csv", recording, head())


def test_only_a_bare_name_wants_a_capture(capture: Capture) -> None:
    assert names_segment("random5")
    assert not any(map(names_segment, (*MOTIONS, "a.csv", "a.MP4", f"{capture.path}:wave")))


def test_names_alone_are_of_the_capture_that_the_avatar_was_trained_on(capture: Capture, tmp_path: Path) -> None:
    there = Run.create(tmp_path / "there", capture.path, preset("tiny"))
    assert own_capture(there.path) == own_capture(there.avatar) == capture.path.resolve()
    gone = Run.create(tmp_path / "gone", tmp_path / "nowhere", preset("tiny"))
    assert own_capture(gone.path) is None
    assert own_capture(tmp_path / "an avatar from elsewhere") is None


def expressive(basis: ExpressionBasis | None, *rows: list[float], rest: list[float]) -> TimedMotion:
    motion = smooth_motion(np.arange(len(rows)) / FPS)
    pose = RestPose(np.eye(3), np.zeros(3), np.array(rest, np.float32))
    return dataclasses.replace(motion, expressions=np.array(rows, np.float32), rest=pose, expression_basis=basis)


@pytest.mark.parametrize("bases", [(None, None), (BASIS, None), (None, BASIS), (BASIS, ExpressionBasis("Anny"))])
def test_the_drivers_neutral_face_is_the_avatars(bases: tuple[ExpressionBasis | None, ...]) -> None:
    motion = expressive(bases[0], [0.25, 0.0, 0.5], [0.75, 0.0, 0.5], rest=[0.25, 0.0, 0.5])
    found, said = carried_expressions(motion, NEUTRAL, bases[1])
    np.testing.assert_allclose(found, [NEUTRAL, NEUTRAL + np.array([0.5, 0, 0], np.float32)])
    assert said is None


def test_namesakes_are_carried_over_however_they_are_spelt() -> None:
    other = ExpressionBasis("ARKit", ("browInnerUp", "EyeBlink_L", "jaw_open", "mouthSmileRight"))
    motion = expressive(other, [0.9, 0.1, 0.2, 0.3], [0.9, 0.0, 0.0, 0.0], rest=[0.0, 0.0, 0.0, 0.0])
    found, said = carried_expressions(motion, NEUTRAL, BASIS)
    np.testing.assert_allclose(found, [NEUTRAL + np.array([0.2, 0.1, 0.3], np.float32), NEUTRAL])
    assert said == "3 of the driver's 4 expressions are carried over by name, to 3 of the avatar's 3"


def test_coefficients_without_names_count_for_nothing() -> None:
    """As in the bundled capture, whose first few alone move the face."""
    sample = ExpressionBasis("four", ("jaw_open", "smile", "", "", "", "", ""))
    other = ExpressionBasis("ARKit", ("mouthSmileLeft", "mouthSmileRight", "jawOpen", "cheekPuff", ""))
    neutral = np.linspace(0.0, 0.6, 7, dtype=np.float32)
    motion = expressive(other, [0.2, 0.4, 0.5, 0.9, 0.9], [0.0, 0.0, 0.1, 0.0, 0.0], rest=[0.0, 0.0, 0.1, 0.0, 0.0])
    found, said = carried_expressions(motion, neutral, sample)
    np.testing.assert_allclose(found - neutral, [[0.4, 0.3, 0, 0, 0, 0, 0], [0.0] * 7], atol=1e-6)
    assert said == "3 of the driver's 5 expressions are carried over by name, to 2 of the avatar's 7"


def test_a_driver_of_few_expressions_needs_only_those() -> None:
    few = ExpressionBasis("four", ("jaw_open", "smile", "", ""))
    many = ExpressionBasis("ARKit", ("a", "b", "c", "jawOpen", "d", "e", "mouthSmile_L", "mouthSmile_R"))
    neutral = np.zeros(8, np.float32)
    found, said = carried_expressions(expressive(few, [0.5, 0.25, 1, 1], [0.0] * 4, rest=[0.0] * 4), neutral, many)
    np.testing.assert_allclose(found[0], [0, 0, 0, 0.5, 0, 0, 0.25, 0.25])
    assert said == "2 of the driver's 4 expressions are carried over by name, to 3 of the avatar's 8"


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (ExpressionBasis("FLAME"), "face model 'FLAME', the avatar's of 'Anny'"),
        (ExpressionBasis("FLAME", ("jawOpen", "a", "b", "c")), "face model 'FLAME'"),
        (None, "the driver has 4 coefficients, the avatar 3"),
    ],
)
def test_what_cannot_be_understood_stays_neutral(other: ExpressionBasis | None, said: str) -> None:
    motion = expressive(other, [0.0] * 4, [0.1, 0.2, 0.3, 0.4], rest=[0.0] * 4)
    found, why = carried_expressions(motion, NEUTRAL, BASIS)
    np.testing.assert_array_equal(found, [NEUTRAL, NEUTRAL])
    assert why is not None
    assert said in why


def test_a_face_that_does_not_move_needs_no_words() -> None:
    motion = expressive(ExpressionBasis("FLAME"), [0.3, 0.1], [0.3, 0.1], rest=[0.3, 0.1])
    assert carried_expressions(motion, NEUTRAL, BASIS)[1] is None
