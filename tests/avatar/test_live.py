"""The avatar driven pose by pose, against the whole track at once."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar, LiveAvatar, PosedAvatar, head_pose
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion import SignalNormalizer, motion_signals
from tiny_avatars import SMALL, front_camera, make_avatar

FPS = 30.0
AVATAR = make_avatar().eval()
AVATAR.normalizer.get_buffer("omega_max").fill_(10.0)
AVATAR.normalizer.get_buffer("alpha_max").fill_(500.0)


def random_track(frames: int, seed: int = 0, fps: float = FPS) -> HeadTrack:
    random = np.random.default_rng(seed)
    return HeadTrack(
        rotations=Rotation.from_rotvec(0.3 * random.standard_normal((frames, 3)).cumsum(0)).as_matrix(),
        translations=0.01 * random.standard_normal((frames, 3)).cumsum(0),
        expressions=random.random((frames, 4), np.float32),
        fps=fps,
        gravity=np.array([1.0, -9.0, 0.5]),
    )


def some(track: HeadTrack, frames: slice) -> HeadTrack:
    return replace(
        track,
        rotations=track.rotations[frames],
        translations=track.translations[frames],
        expressions=track.expressions[frames],
    )


def driven(live: LiveAvatar, track: HeadTrack) -> list[PosedAvatar | None]:
    poses = zip(track.rotations, track.translations, track.expressions, strict=True)
    return [live.step(*pose, track.gravity) for pose in poses]


def assert_same(posed: PosedAvatar | None, expected: PosedAvatar) -> None:
    assert posed is not None
    torch.testing.assert_close(posed.strands, expected.strands, atol=1e-6, rtol=0)
    for name in ("means", "quats", "scales", "opacities", "colours"):
        torch.testing.assert_close(getattr(posed.head, name), getattr(expected.head, name), atol=1e-6, rtol=1e-5)


@settings(max_examples=6)
@given(frames=st.integers(1, 12), seed=st.integers(0, 99))
def test_two_frames_late_it_is_the_whole_track(frames: int, seed: int) -> None:
    track, live = random_track(frames, seed), AVATAR.live(FPS)
    early = driven(live, track)
    assert all(posed is None for posed in early[:2])
    shown = [*early[2:], *live.finish()]
    assert len(shown) == frames
    for frame, posed in enumerate(shown):
        assert_same(posed, AVATAR.pose(track, frame))


@settings(max_examples=4)
@given(frames=st.integers(1, 9), seed=st.integers(0, 99), delay=st.sampled_from([0, 1]))
def test_sooner_it_is_the_track_so_far(frames: int, seed: int, delay: int) -> None:
    track = random_track(frames, seed)
    for frame, posed in enumerate(driven(AVATAR.live(FPS, delay), track)):
        if frame < delay:
            assert posed is None
        else:
            assert_same(posed, AVATAR.pose(some(track, slice(frame + 1)), frame - delay))


@pytest.mark.parametrize(
    "change",
    [{"signals": "pose"}, {"kind": "modal", "turn": True}, {"kind": "strands", "history": 12}, {"encoder": "mlp"}],
    ids=str,
)
def test_every_kind_of_hair_motion_can_be_driven(change: dict[str, str | bool]) -> None:
    track, deformer = random_track(7), replace(SMALL, **change)  # pyright: ignore[reportArgumentType]
    avatar = make_avatar(deformer=deformer).eval()
    avatar.normalizer = SignalNormalizer.fit([motion_signals(track)], deformer)
    live = avatar.live(FPS)
    for frame, posed in enumerate([*driven(live, track)[2:], *live.finish()]):
        assert_same(posed, avatar.pose(track, frame))


def test_rigid_hair_can_be_driven() -> None:
    avatar, track = make_avatar(dynamic=False).eval(), random_track(3)
    assert_same(driven(avatar.live(delay=0), track)[-1], avatar.pose(track, 2))


def test_the_recording_says_what_is_not_said() -> None:
    recording = AVATAR.recording
    assert recording is not None
    live = AVATAR.live(delay=0)
    assert live.fps == recording.fps
    track = HeadTrack(
        rotations=recording.rest.rotation.double().numpy()[None],
        translations=recording.rest.translation.double().numpy()[None],
        expressions=recording.rest.expression.numpy()[None],
        fps=recording.fps,
        gravity=recording.gravity,
    )
    assert_same(live.step(recording.rest.rotation, recording.rest.translation), AVATAR.pose(track, 0))


def test_a_finished_motion_leaves_nothing_to_the_next() -> None:
    one, other, live = random_track(6, 1), random_track(4, 2), AVATAR.live(FPS)
    driven(live, one)
    assert len(live.finish()) == 2
    assert live.finish() == []
    assert_same(driven(live, other)[2], AVATAR.pose(other, 0))


def test_memory_does_not_grow() -> None:
    track, live = random_track(16), AVATAR.live(FPS, delay=0)

    def held(steps: HeadTrack) -> int:
        driven(live, steps)
        gc.collect()
        return sum(type(thing) is torch.Tensor for thing in gc.get_objects())

    assert held(some(track, slice(8))) == held(some(track, slice(8, 16)))


def smooth(times: Sequence[float] | np.ndarray) -> HeadTrack:
    """A turn about one axis of constant acceleration: what parabolas can follow exactly."""
    t = np.array(times)[:, None]
    angle = 0.3 * t + 2.0 * t**2
    return HeadTrack(
        rotations=Rotation.from_rotvec(angle * np.array([0.0, 0.6, 0.8])).as_matrix(),
        translations=np.hstack([t, t**2, 1 - t]),
        expressions=np.hstack([t, t, t, t]).astype(np.float32),
        fps=FPS,
        gravity=np.array([0, -9.81, 0.0]),
    )


@pytest.mark.parametrize("every", [1 / 70, 1 / 24, None], ids=str)
def test_poses_at_other_times_are_resampled(every: float | None) -> None:
    random = np.random.default_rng(0)
    gaps = random.uniform(0.005, 0.09, 12) if every is None else np.full(12, every)
    times = [0.0, 1e-3, *(1e-3 + gaps.cumsum())]  # three poses before the first instant that is between
    live, source, frames = AVATAR.live(FPS, delay=0), smooth(times), 0
    expected = smooth(np.arange(int(times[-1] * FPS) + 1) / FPS)
    for index, time in enumerate(times):
        posed = live.step(
            source.rotations[index], source.translations[index], source.expressions[index], time=100 + time
        )
        reached = int(np.floor(time * FPS + 1e-4)) + 1
        assert (posed is None) == (reached == frames)
        frames = reached
        if posed is not None:
            assert_same_within(posed, AVATAR.pose(some(expected, slice(reached)), reached - 1), 1e-4)
    assert frames == len(expected.rotations)


def assert_same_within(posed: PosedAvatar, expected: PosedAvatar, metres: float) -> None:
    torch.testing.assert_close(posed.strands, expected.strands, atol=metres, rtol=0)
    torch.testing.assert_close(posed.head.means, expected.head.means, atol=metres, rtol=0)


def test_after_a_gap_a_motion_begins_anew() -> None:
    track, live = random_track(6), AVATAR.live(FPS, delay=0)
    poses = list(zip(track.rotations, track.translations, track.expressions, strict=True))
    for index in range(3):
        live.step(*poses[index], track.gravity, time=index / FPS)
    for index in range(3, 6):
        posed = live.step(*poses[index], track.gravity, time=10 + index / FPS)
        assert_same(posed, AVATAR.pose(some(track, slice(3, index + 1)), index - 3))


def test_what_is_no_pose_is_refused() -> None:
    eye, zero = np.eye(3), np.zeros(3)
    live = AVATAR.live()
    for rotation in (2 * eye, -eye, eye[:2], np.full((3, 3), np.nan)):
        with pytest.raises(DynhairError, match="head pose"):
            live.step(rotation, zero)
    with pytest.raises(DynhairError, match="shapes"):
        live.step(eye, np.zeros(2))
    with pytest.raises(DynhairError, match="3 expression coefficients"):
        live.step(eye, zero, np.zeros(3))
    live.step(eye, zero, time=1.0)
    for time in (1.0, 0.5, float("nan")):
        with pytest.raises(DynhairError, match="expected: a time after"):
            live.step(eye, zero, time=time)
    with pytest.raises(DynhairError, match="some have none"):
        live.step(eye, zero)
    live.finish()
    live.step(eye, zero)


def test_rates_and_delays_that_cannot_be() -> None:
    unknown = make_avatar()
    unknown.recording = None
    with pytest.raises(DynhairError, match="frames a second"):
        unknown.live()
    assert unknown.live(fps=24.0).fps == 24
    for fps in (0.0, -1.0, float("nan")):
        with pytest.raises(DynhairError, match="frame rate"):
            AVATAR.live(fps=fps)
    for delay in (-1, 3):
        with pytest.raises(DynhairError, match="delay"):
            AVATAR.live(delay=delay)


def test_an_image_shows_the_hair_at_rest_under_its_gravity() -> None:
    avatar, camera = make_avatar().eval(), front_camera()
    turn = Rotation.from_euler("x", 40, degrees=True).as_matrix()
    place, expression = np.array([0.0, 0.7, 0.0]), np.array([0.1, 0.4, 0.2, 0.0])
    assert avatar.recording is not None
    track = HeadTrack(turn[None], place[None], expression[None].astype(np.float32), 10.0, avatar.recording.gravity)
    expected = avatar.draw(avatar.pose(track, 0), [camera]).rgb[0]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, place
    for pose in (head_pose(track, 0), matrix, torch.from_numpy(matrix), (turn, place)):
        image = avatar.render(pose, expression)
        assert not image.requires_grad
        torch.testing.assert_close(image, expected.clamp(0, 1), atol=1e-5, rtol=0)
    own = avatar.render(head_pose(track, 0), camera=camera.resized(20, 20))
    torch.testing.assert_close(own, avatar.render(matrix, expression, camera.resized(20, 20)), atol=1e-5, rtol=0)
    rest = avatar.recording.rest
    torch.testing.assert_close(avatar.render((rest.rotation, rest.translation)), avatar.render(rest))


def test_an_image_needs_a_pose_and_a_camera() -> None:
    for pose in (np.eye(3), 2 * np.eye(4)):
        with pytest.raises(DynhairError, match="last row"):
            AVATAR.render(pose)
    unknown: Avatar = make_avatar()
    unknown.recording = None
    with pytest.raises(DynhairError, match="name a camera"):
        unknown.render(np.eye(4))
    assert unknown.render(np.eye(4), camera=front_camera(8)).shape == (8, 8, 3)
