"""Pictures and videos: what was put in is what can be read back."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
import torch

from dynhair.evaluation.pictures import LARGEST_ERROR, error_picture, picture
from dynhair.pictures import grid
from dynhair.video import video_writer


def read_video(path: Path) -> tuple[list[np.ndarray], Fraction, str, str]:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        return frames, stream.average_rate or Fraction(0), stream.codec_context.name, str(stream.codec_context.pix_fmt)


def test_small_images_are_doubled_and_large_ones_kept() -> None:
    assert picture(torch.zeros(20, 30, 3)).shape == (40, 60, 3)
    assert picture(torch.zeros(512, 30, 3)).shape == (512, 30, 3)


def test_pictures_round_to_the_nearest_of_256_values() -> None:
    values = torch.tensor([0.0, 0.2509, 1.0, 1.7, -0.3])
    shown = picture(values[:, None, None].expand(5, 400, 3).transpose(0, 1))
    assert shown[0, :, 0].tolist() == [0, 64, 255, 255, 0]


def test_the_error_map_brightens_with_the_error() -> None:
    error = torch.linspace(0.0, LARGEST_ERROR, 12)
    image = error[None, :, None].expand(400, 12, 3)
    shown = error_picture(image, torch.zeros_like(image)).astype(float)[0]
    luminance = shown @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) > 0).all()
    assert shown[0].max() < 5
    np.testing.assert_array_equal(error_picture(2 * image, image), error_picture(image, torch.zeros_like(image)))


def test_grids_hold_their_pictures_unchanged() -> None:
    generator = np.random.default_rng(0)
    rows = [[generator.integers(0, 256, (48, 64, 3), np.uint8) for _ in range(3)] for _ in range(2)]
    sheet = grid(rows, ["truth", "avatar"], ["a", "b", "c"])
    windows = np.lib.stride_tricks.sliding_window_view(sheet, (48, 64, 3))[:, :, 0]
    places = []
    for row in rows:
        for cell in row:
            found = np.argwhere((windows[:, :, 0, 0] == cell[0, 0]).all(-1))
            places.append([tuple(p) for p in found if np.array_equal(windows[tuple(p)], cell)])
    assert all(len(place) == 1 for place in places)
    tops, lefts = np.array(places)[:, 0].reshape(2, 3, 2).transpose(2, 0, 1)
    assert (np.diff(tops, axis=0) > 48).all()
    assert (np.diff(lefts, axis=1) > 64).all()


def test_a_video_plays_as_written(tmp_path: Path) -> None:
    colours = [(200, 30, 30), (30, 180, 60), (40, 60, 220), (128, 128, 128)]
    with video_writer(tmp_path / "film.mp4", 30000 / 1001) as append:
        for colour in colours:
            append(np.full((48, 64, 3), colour, np.uint8))
    frames, rate, codec, layout = read_video(tmp_path / "film.mp4")
    assert (rate, codec, layout) == (Fraction(30000, 1001), "h264", "yuv420p")
    for frame, colour in zip(frames, colours, strict=True):
        assert frame.shape == (48, 64, 3)
        assert np.abs(frame.astype(int) - colour).max() < 12


def test_the_index_comes_first_so_that_browsers_start_at_once(tmp_path: Path) -> None:
    with video_writer(tmp_path / "film.mp4", 25.0) as append:
        append(np.zeros((48, 64, 3), np.uint8))
    written = (tmp_path / "film.mp4").read_bytes()
    assert 0 < written.index(b"moov") < written.index(b"mdat")


def test_odd_sizes_are_made_even(tmp_path: Path) -> None:
    with video_writer(tmp_path / "film.mp4", 25.0) as append:
        append(np.zeros((47, 63, 3), np.uint8))
    assert read_video(tmp_path / "film.mp4")[0][0].shape == (48, 64, 3)


@pytest.mark.parametrize("frames", [0, 3])
def test_an_error_leaves_no_video(tmp_path: Path, frames: int) -> None:
    def interrupted() -> None:
        with video_writer(tmp_path / "film.mp4", 25.0) as append:
            for _ in range(frames):
                append(np.zeros((48, 64, 3), np.uint8))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []
