"""Films as they come: turned, uneven, damaged, or none."""

from __future__ import annotations

import wave
from pathlib import Path

import numpy as np
import pytest
from filmed_faces import MARK, grey, write_film, write_marked_film

from dynhair.animation.video_driver_frames import frame_count, timed_frames
from dynhair.errors import DynhairError


def silent(text: str) -> None:
    raise AssertionError(text)


def test_frames_come_with_their_times(tmp_path: Path) -> None:
    times = [0.0, 0.04, 0.11, 0.5, 0.52]
    path = write_marked_film(tmp_path / "uneven.mp4", times)
    frames = list(timed_frames(path, silent))
    np.testing.assert_allclose([frame.time for frame in frames], times, atol=1e-3)
    assert [round(float(frame.pixels.mean()) / MARK) for frame in frames] == [0, 1, 2, 3, 4]
    assert frame_count(path) == 5


@pytest.mark.parametrize(("rotation", "turns"), [(0, 0), (90, 1), (180, 2), (-90, -1)])
def test_films_that_lie_on_their_side_are_turned(tmp_path: Path, rotation: int, turns: int) -> None:
    upright = np.zeros((64, 96, 3), np.uint8)
    upright[:20, :30] = 255
    path = write_film(tmp_path / "lying.mp4", [np.ascontiguousarray(np.rot90(upright, -turns))] * 2, rotation=rotation)
    for frame in timed_frames(path, silent):
        np.testing.assert_array_equal(frame.pixels, upright)


def test_what_breaks_off_is_followed_until_there(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    noise = [rng.integers(0, 255, (64, 96, 3), dtype=np.uint8) for _ in range(30)]
    path = write_film(tmp_path / "whole.mp4", noise)
    content = bytearray(path.read_bytes())
    start = content.index(b"mdat") + 4
    end = start + int.from_bytes(content[start - 8 : start - 4], "big") - 8
    content[(start + end) // 2 : end] = bytes(end - (start + end) // 2)
    path.write_bytes(content)
    notes: list[str] = []
    frames = list(timed_frames(path, notes.append))
    assert 5 < len(frames) < 25
    np.testing.assert_array_equal(frames[3].pixels, noise[3])
    assert all("damaged" in note for note in notes)


def test_a_missing_film(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="missing"):
        list(timed_frames(tmp_path / "none.mp4", silent))


def test_a_file_that_is_no_film(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    path.write_bytes(np.random.default_rng(0).bytes(4000))
    with pytest.raises(DynhairError, match="cannot be decoded"):
        list(timed_frames(path, silent))


def test_a_film_cut_off_before_its_index(tmp_path: Path) -> None:
    path = write_film(tmp_path / "whole.mp4", [grey(level) for level in range(20)])
    path.write_bytes(path.read_bytes()[:-900])
    with pytest.raises(DynhairError, match="cannot be decoded"):
        list(timed_frames(path, silent))


def test_sound_alone(tmp_path: Path) -> None:
    path = tmp_path / "sound.wav"
    with wave.open(str(path), "wb") as sound:
        sound.setnchannels(1)
        sound.setsampwidth(2)
        sound.setframerate(8000)
        sound.writeframes(bytes(1600))
    with pytest.raises(DynhairError, match="no video stream"):
        list(timed_frames(path, silent))
