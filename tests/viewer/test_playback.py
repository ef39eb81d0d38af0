from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.viewer.playback import Playback

RATES = st.sampled_from([10.0, 24.0, 29.97, 30.0, 60.0])


def test_a_motion_stands_until_it_is_played() -> None:
    standing = Playback(10, 30.0)
    assert standing.frame(0.0) == standing.frame(100.0) == 0
    assert standing.wait(5.0) is None


@given(fps=RATES, frame=st.integers(0, 500), start=st.floats(0, 1e6), speed=st.floats(0.1, 2))
def test_frames_are_due_at_their_instants_and_the_motion_loops(
    fps: float, frame: int, start: float, speed: float
) -> None:
    playing = Playback(50, fps, speed=speed).play(start)
    assert playing.frame(start + (frame + 0.01) / (fps * speed)) == frame % 50
    assert playing.frame(start + (frame + 0.99) / (fps * speed)) == frame % 50


@given(fps=RATES, now=st.floats(0, 100), speed=st.floats(0.1, 2))
def test_the_next_frame_is_another_after_the_wait_and_not_before(fps: float, now: float, speed: float) -> None:
    playing = Playback(50, fps, speed=speed).play(0.0)
    wait = playing.wait(now)
    assert wait is not None
    assert 0 < wait <= 1.001 / (fps * speed)
    assert playing.frame(now + wait + 1e-6) == (playing.frame(now) + 1) % 50
    assert playing.frame(now + 0.9 * wait) == playing.frame(now)


def test_a_pause_keeps_the_place() -> None:
    paused = Playback(100, 10.0).play(0.0).pause(2.55)
    assert paused.frame(50.0) == 25
    assert paused.play(60.0).frame(60.06) == 26


def test_repeated_changes_of_speed_do_not_move_the_place() -> None:
    playing = Playback(1000, 30.0).play(0.0)
    for _ in range(100):
        playing = playing.at_speed(2.0, 1.0).at_speed(1.0, 1.0)
    assert playing.frame(1.0) == 30
    assert playing.at_speed(0.5, 1.0).frame(3.0) == 60


@pytest.mark.parametrize(("asked", "found"), [(7, 7), (-3, 0), (99, 9)])
def test_scrubbing_stops_at_a_frame(asked: int, found: int) -> None:
    there = Playback(10, 30.0).play(0.0).scrub(asked, 1.0)
    assert not there.playing
    assert there.frame(20.0) == found
