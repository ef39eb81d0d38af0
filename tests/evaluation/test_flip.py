"""FLIP against the program of its authors."""

from __future__ import annotations

import cv2
import flip_evaluator
import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from dynhair.evaluation.flip import PIXELS_PER_DEGREE, flip, flip_between, flip_map, flip_views

HEIGHT, WIDTH = 48, 67


def picture(seed: int, smoothing: float) -> np.ndarray:
    noise = np.random.default_rng(seed).random((HEIGHT, WIDTH, 3))
    smooth = gaussian_filter(noise, (smoothing, smoothing, 0.0))
    return ((smooth - smooth.min()) / np.ptp(smooth)).astype(np.float32)


PICTURES = {
    "noise": picture(0, 0.0),
    "fine": picture(1, 1.0),
    "coarse": picture(2, 6.0),
    "black": np.zeros((HEIGHT, WIDTH, 3), np.float32),
    "green": np.tile(np.array([0.0, 1.0, 0.0], np.float32), (HEIGHT, WIDTH, 1)),
    "blue": np.tile(np.array([0.0, 0.0, 1.0], np.float32), (HEIGHT, WIDTH, 1)),
}
PAIRS = [("noise", "fine"), ("fine", "coarse"), ("coarse", "black"), ("noise", "green"), ("green", "blue")]


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_maps_equal_those_of_the_authors_program(first: str, second: str) -> None:
    a, b = PICTURES[first], PICTURES[second]
    expected, mean, settings = flip_evaluator.evaluate(b, a, "LDR", applyMagma=False)
    assert settings["ppd"] == pytest.approx(PIXELS_PER_DEGREE)
    views = flip_views(torch.from_numpy(np.stack([a, b])))
    np.testing.assert_allclose(flip_map(*views), expected[..., 0], atol=1e-4)
    found = flip(torch.from_numpy(a)[None], torch.from_numpy(b)[None])
    assert found.item() == pytest.approx(mean, abs=5e-5)


def test_each_view_is_compared_with_its_own() -> None:
    first = torch.from_numpy(np.stack([PICTURES["noise"], PICTURES["fine"], PICTURES["coarse"]]))
    second = torch.from_numpy(np.stack([PICTURES["fine"], PICTURES["fine"], PICTURES["black"]]))
    found = flip(first, second)
    alone = [flip(a[None], b[None]).item() for a, b in zip(first, second, strict=True)]
    assert found.tolist() == alone
    assert found[1] == 0.0
    assert 0.0 < found[0] < 1.0
    torch.testing.assert_close(found, flip(second, first))
    assert torch.equal(flip_between(flip_views(first), flip_views(second)), found)


def test_a_blur_is_seen_the_more_the_stronger_it_is() -> None:
    sharp = PICTURES["fine"]
    blurred = [cv2.GaussianBlur(sharp, (0, 0), sigma) for sigma in (0.5, 1.0, 2.0)]
    found = flip(torch.from_numpy(np.stack(blurred)), torch.from_numpy(sharp).expand(3, -1, -1, -1))
    assert found.diff().min() > 0.0
