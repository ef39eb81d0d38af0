from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar, Recording
from dynhair.viewer.motions import Clip, under_gravity
from dynhair.viewer.settings import LIVE, HairEdits, Settings
from dynhair.viewer.stage import Stage
from tiny_avatars import FRAMES, head_track, make_avatar

AVATAR = make_avatar().eval().requires_grad_(False)
CLIPS = {"one": Clip("one", head_track()), "other": Clip("other", head_track(head_track().rotations[::-1].copy()))}
SETTINGS = Settings("one")


def recording() -> Recording:
    assert AVATAR.recording is not None
    return AVATAR.recording


@pytest.fixture
def stage() -> Stage:
    return Stage(AVATAR, recording(), CLIPS, SETTINGS, 0.0)


def assert_shows(stage: Stage, now: float, expected: torch.Tensor) -> None:
    torch.testing.assert_close(stage.shown(now).avatar.strands, expected, atol=1e-6, rtol=0)


@pytest.mark.parametrize("frame", range(FRAMES))
def test_a_frame_of_a_motion_is_the_avatars_own_pose(stage: Stage, frame: int) -> None:
    stage.scrub(frame, 0.0)
    expected = AVATAR.pose(CLIPS["one"].track, frame)
    assert_shows(stage, 1.0, expected.strands)
    torch.testing.assert_close(stage.shown(1.0).avatar.head.means, expected.head.means)


def test_playing_goes_on_with_time_and_loops(stage: Stage) -> None:
    stage.play_or_pause(0.0)
    assert stage.playing
    assert_shows(stage, 0.31, AVATAR.pose(CLIPS["one"].track, 3).strands)
    assert stage.frame(FRAMES / 10 + 0.01) == 0


def test_nothing_is_posed_twice(stage: Stage) -> None:
    assert stage.shown(0.0) is stage.shown(5.0)
    stage.adopt(replace(SETTINGS, display="splats"), 5.0)
    assert stage.shown(5.0) is stage.shown(6.0)
    stage.adopt(replace(SETTINGS, edits=HairEdits(thin=0.5)), 6.0)
    thin = stage.shown(6.0)
    assert thin is stage.shown(7.0)
    assert len(thin.avatar.strands) == 10


def test_edits_are_the_avatars_own_and_can_be_taken_back(stage: Stage) -> None:
    before = stage.shown(0.0).avatar
    edits = HairEdits(brightness=0.5, trim=0.25, width=2.0, tint_strength=0.5)
    stage.adopt(replace(SETTINGS, edits=edits), 0.0)
    after = stage.shown(0.0).avatar
    expected = AVATAR.edited(*edits.edits()).pose(CLIPS["one"].track, 0)
    torch.testing.assert_close(after.strands, expected.strands)
    torch.testing.assert_close(after.hair.base_harmonic, expected.hair.base_harmonic)
    torch.testing.assert_close(after.hair.widths, 2 * before.hair.widths)
    stage.adopt(SETTINGS, 0.0)
    torch.testing.assert_close(stage.shown(0.0).avatar.strands, before.strands)
    assert AVATAR.edits == ()


def test_rigid_hair_keeps_its_shape(stage: Stage) -> None:
    stage.adopt(replace(SETTINGS, rigid=True), 0.0)
    stage.scrub(3, 0.0)
    assert_shows(stage, 0.0, AVATAR.pose(CLIPS["one"].track, 3, rigid_hair=True).strands)


def test_tilted_gravity_reaches_the_hair_alone(stage: Stage) -> None:
    before = stage.shown(0.0).avatar
    stage.adopt(replace(SETTINGS, gravity=(30.0, 10.0)), 0.0)
    track = under_gravity(CLIPS["one"].track, (30.0, 10.0))
    assert_shows(stage, 0.0, AVATAR.pose(track, 0).strands)
    assert not torch.allclose(stage.shown(0.0).avatar.strands, before.strands)
    torch.testing.assert_close(stage.shown(0.0).avatar.head.means, before.head.means)


@pytest.mark.parametrize(
    ("tilt", "direction"), [((0.0, 0.0), (0, -1, 0)), ((90.0, 0.0), (0, 0, 1)), ((0.0, 90.0), (1, 0, 0))]
)
def test_gravity_tilts_to_the_front_and_to_the_side(
    tilt: tuple[float, float], direction: tuple[float, float, float]
) -> None:
    gravity = under_gravity(head_track(), tilt).gravity
    np.testing.assert_allclose(gravity, 9.81 * np.array(direction), atol=1e-9)


def test_an_expression_slider_adds_to_the_motions_coefficient(stage: Stage) -> None:
    stage.adopt(replace(SETTINGS, expression=((2, 0.7),)), 0.0)
    stage.shown(0.0)
    stage.adopt(replace(SETTINGS, expression=((2, 0.7),), gravity=(1.0, 0.0)), 0.0)
    track = head_track()
    track.expressions[:, 2] += np.float32(0.7)
    torch.testing.assert_close(stage.shown(0.0).avatar.head.means, AVATAR.pose(track, 0).head.means)


def test_another_motion_begins_at_its_beginning_and_plays_if_one_did(stage: Stage) -> None:
    stage.play_or_pause(0.0)
    stage.adopt(replace(SETTINGS, motion="other"), 0.25)
    assert stage.frame(0.25) == 0
    assert stage.playing
    assert_shows(stage, 0.25, AVATAR.pose(CLIPS["other"].track, 0).strands)


def test_speeds_are_those_of_the_strands_in_the_head(stage: Stage) -> None:
    stage.adopt(replace(SETTINGS, colours="speed"), 0.0)
    stage.scrub(2, 0.0)
    speeds = stage.shown(0.0).speeds
    before, now = AVATAR.deformed_strands(CLIPS["one"].track, [1, 2])
    assert speeds is not None
    torch.testing.assert_close(speeds, (now - before).norm(dim=-1).mean(1) * 10.0)
    stage.adopt(replace(SETTINGS, colours="speed", rigid=True), 0.0)
    still = stage.shown(0.0).speeds
    assert still is not None
    assert not still.any()


def test_a_dragged_head_arrives_and_the_hair_comes_to_rest(stage: Stage) -> None:
    stage.adopt(replace(SETTINGS, motion=LIVE), 0.0)
    assert stage.wait(0.0) is None
    rotation, translation = Rotation.from_euler("y", 0.4).as_matrix(), np.array([0.0, 0.72, 0.0])
    stage.aim(rotation, translation, 0.0)
    assert stage.wait(0.0) is not None
    moving = stage.shown(0.2)
    assert not torch.allclose(moving.avatar.strands, stage.shown(0.4).avatar.strands)
    for second in range(1, 7):
        stage.shown(float(second))
    assert stage.wait(7.0) is None
    assert stage.shown(7.0) is stage.shown(9.0)
    still = replace(
        head_track(), rotations=np.tile(rotation, (FRAMES, 1, 1)), translations=np.tile(translation, (FRAMES, 1))
    )
    assert_shows(stage, 7.0, AVATAR.pose(still, FRAMES - 1).strands)


def test_rigid_avatars_are_shown_too() -> None:
    avatar: Avatar = make_avatar(dynamic=False)
    stage = Stage(avatar, recording(), CLIPS, SETTINGS, 0.0)
    with torch.no_grad():
        torch.testing.assert_close(stage.shown(0.0).avatar.strands, avatar.pose(CLIPS["one"].track, 0).strands)
