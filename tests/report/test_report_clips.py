"""Clips: each panel is found where evaluations put it, and videos and sheets show the same frames."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest
from made_comparisons import FRAMES, GROUND, SIZE, write_video

from dynhair.errors import DynhairError
from dynhair.pictures import Picture, grid
from dynhair.report.clips import Clip, contact_sheet, write_clip, write_side_by_side
from dynhair.video import video_writer

ASPECT = SIZE[0] / SIZE[1]


def read(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(container.streams.video[0])]


def colour(picture: Picture) -> tuple[int, ...]:
    """Of the right edge, which no bar of `write_video` reaches."""
    return tuple(picture[4:-4, -8:-4].reshape(-1, 3).mean(axis=0))


@pytest.mark.parametrize(("panel", "name"), [(0, "truth"), (1, "gha")])
def test_a_panel_is_cut_out_exactly(tmp_path: Path, panel: int, name: str) -> None:
    write_video(tmp_path / "v.mp4", "gha")
    frames = list(Clip(tmp_path / "v.mp4", panel, ASPECT).frames())
    assert len(frames) == FRAMES
    assert {frame.shape for frame in frames} == {(SIZE[1], SIZE[0], 3)}
    np.testing.assert_allclose(colour(frames[0]), GROUND[name], atol=12)
    edges = np.concatenate([frames[0][1], frames[0][-2], frames[0][:, -2]]).astype(float)
    assert np.abs(edges - GROUND[name]).max(axis=1).mean() < 60  # no paper of the margins


@pytest.mark.parametrize("size", [(64, 64), (101, 77), (33, 80), (256, 144)])
def test_panels_of_any_size_are_found(tmp_path: Path, size: tuple[int, int]) -> None:
    width, height = size
    panels = [np.full((height, width, 3), value, np.uint8) for value in (90, 200)]
    with video_writer(tmp_path / "v.mp4", 30.0) as append:
        append(grid([panels], [""], ["truth", "avatar"]))
    for panel, value in enumerate((90, 200)):
        (frame,) = Clip(tmp_path / "v.mp4", panel, width / height).frames()
        assert frame.shape == (height, width, 3)
        assert np.abs(frame.astype(int) - value).mean() < 4


def test_a_video_of_another_layout_is_refused(tmp_path: Path) -> None:
    with video_writer(tmp_path / "v.mp4", 30.0) as append:
        append(np.zeros((64, 64, 3), np.uint8))
    with pytest.raises(DynhairError, match="hold no panel 2"):
        list(Clip(tmp_path / "v.mp4", 1, ASPECT).frames())


def test_a_broken_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_bytes(b"no video")
    clip = Clip(tmp_path / "v.mp4", 0, ASPECT)
    with pytest.raises(DynhairError, match="not readable as a video"):
        list(clip.frames())
    with pytest.raises(DynhairError, match="not readable as a video"):
        clip.length()


def test_a_video_that_ends_early_is_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mp4", "gha")
    clip = Clip(tmp_path / "v.mp4", 1, ASPECT)
    assert len(clip.some_frames([0, 2])) == 2
    with pytest.raises(DynhairError, match=f"ends before its frame {FRAMES}"):
        clip.some_frames([0, FRAMES])


def test_a_clip_alone_shows_the_method_and_nothing_else(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mp4", "ours")
    write_clip(Clip(tmp_path / "v.mp4", 1, ASPECT), tmp_path / "clip.mp4")
    frames = read(tmp_path / "clip.mp4")
    assert len(frames) == FRAMES
    assert frames[0].shape == (SIZE[1], SIZE[0], 3)
    np.testing.assert_allclose(colour(frames[0]), GROUND["ours"], atol=14)


def test_clips_stand_side_by_side_for_as_long_as_all_last(tmp_path: Path) -> None:
    write_video(tmp_path / "ours.mp4", "ours")
    write_video(tmp_path / "gha.mp4", "gha", frames=FRAMES - 2)
    clips = [Clip(tmp_path / "ours.mp4", 0, ASPECT), *(Clip(tmp_path / f"{m}.mp4", 1, ASPECT) for m in ("ours", "gha"))]
    write_side_by_side(clips, ["truth", "Ours", "GHA"], tmp_path / "all.mp4")
    frames = read(tmp_path / "all.mp4")
    assert len(frames) == FRAMES - 2
    for panel, name in enumerate(("truth", "ours", "gha")):
        (first, *_) = Clip(tmp_path / "all.mp4", panel, ASPECT).frames()
        np.testing.assert_allclose(colour(first), GROUND[name], atol=16)


def test_a_contact_sheet_has_the_same_frames_in_each_row(tmp_path: Path) -> None:
    write_video(tmp_path / "ours.mp4", "ours")
    clips = [Clip(tmp_path / "ours.mp4", panel, ASPECT) for panel in (0, 1)]
    sheet = contact_sheet(clips, ["truth", "Ours"], 4)
    frames = [list(clip.frames()) for clip in clips]
    for row in range(2):
        for index in (1, 3, 5, 7):
            assert holds(sheet, frames[row][index])
        assert not holds(sheet, frames[row][0])


def holds(sheet: Picture, cell: Picture) -> bool:
    height, width = cell.shape[:2]
    windows = np.lib.stride_tricks.sliding_window_view(sheet, (height, width, 3))[:, :, 0]
    places = np.argwhere((windows[:, :, 5, 5] == cell[5, 5]).all(axis=-1))
    return any(np.array_equal(windows[tuple(place)], cell) for place in places)
