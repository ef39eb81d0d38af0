"""Flicker goes; what moves stays as sharp, and where it is."""

from __future__ import annotations

from collections.abc import Iterator

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.preprocess.cleanup import LONGEST, clean_masks

SIZE = 200


def disc(x: float, y: float = 100, radius: float = 40) -> np.ndarray:
    rows, columns = np.mgrid[:SIZE, :SIZE]
    return np.rint(255 * np.clip(radius - np.hypot(rows - y, columns - x) + 0.5, 0, 1)).astype(np.uint8)


def cleaned(masks: list[np.ndarray]) -> list[np.ndarray]:
    return list(clean_masks(iter(masks)))


def test_a_static_mask_stays() -> None:
    masks = [disc(90)] * 7
    for before, after in zip(masks, cleaned(masks), strict=True):
        np.testing.assert_array_equal(after, before)


@pytest.mark.parametrize("speed", [-5.0, 1.3, 3.0])
def test_a_moving_disc_stays_sharp_and_in_place(speed: float) -> None:
    masks = [disc(100 + speed * (t - 6)) for t in range(13)]
    for before, after in zip(masks, cleaned(masks), strict=True):
        inside, found = before > 127, after > 127
        assert (inside & found).sum() > 0.995 * (inside | found).sum()
        assert np.abs(after.astype(float) - before).mean() < 0.1
        columns = np.arange(SIZE)
        assert abs((after @ columns).sum() / after.sum() - (before @ columns).sum() / before.sum()) < 0.02


def test_thin_strands_that_move_stay() -> None:
    def strands(time: int) -> np.ndarray:
        rows, columns = np.mgrid[:SIZE, :SIZE]
        swung = columns - 100 - 12 * np.sin(0.5 * time) * (rows / SIZE) ** 2
        return np.rint(255 * np.exp(-((np.abs(swung) - 20) ** 2) / 4)).astype(np.uint8)

    masks = [strands(time) for time in range(20)]
    for before, after in zip(masks, cleaned(masks), strict=True):
        assert np.abs(after.astype(float) - before).sum() < 0.02 * before.sum()


@pytest.mark.parametrize("length", [1, LONGEST])
def test_a_short_dropout_is_filled(length: int) -> None:
    masks = [disc(80 + time) for time in range(12)]
    broken = [mask.copy() for mask in masks]
    for time in range(5, 5 + length):
        broken[time][85:110, 70:100] = 0
    after = cleaned(broken)
    for time, (mask, found) in enumerate(zip(masks, after, strict=True)):
        assert np.abs(found.astype(float) - mask).mean() < 0.1, time


@pytest.mark.parametrize("length", [1, LONGEST])
def test_a_short_apparition_is_removed(length: int) -> None:
    masks = [disc(60)] * 12
    flickering = [mask.copy() for mask in masks]
    for time in range(4, 4 + length):
        flickering[time][150:170, 150:180] = 255
    for mask, found in zip(masks, cleaned(flickering), strict=True):
        np.testing.assert_array_equal(found, mask)


def test_what_lasts_longer_stays() -> None:
    masks = [disc(60)] * 4 + [disc(60) | disc(150, radius=20)] * (LONGEST + 1) + [disc(60)] * 4
    for before, after in zip(masks, cleaned(masks), strict=True):
        np.testing.assert_array_equal(after, before)


def test_flicker_varies_less_afterwards() -> None:
    generator = np.random.default_rng(0)
    masks = [disc(100, radius=60) for _ in range(40)]
    for time in range(3, 37, 4):
        x, y = generator.integers(80, 120, 2)
        masks[time][disc(x, y, radius=15) > 0] //= 3
    before, after = np.var(np.stack(masks) / 255, 0).sum(), np.var(np.stack(cleaned(masks)) / 255, 0).sum()
    assert after < 0.1 * before


@given(st.integers(0, 12), st.integers(0, 99))
def test_every_mask_comes_out_within_what_was_seen(count: int, seed: int) -> None:
    masks = list(np.random.default_rng(seed).integers(0, 256, (count, 5, 6), dtype=np.uint8))
    after = cleaned(masks)
    assert len(after) == count
    for time, mask in enumerate(after):
        seen = np.stack(masks[max(0, time - LONGEST) : time + LONGEST + 1])
        assert (mask >= seen.min()).all()
        assert (mask <= seen.max()).all()
    if count:
        np.testing.assert_array_equal(after[0], masks[0])
        np.testing.assert_array_equal(after[-1], masks[-1])


@given(hnp.arrays(np.uint8, (9, 4, 5)))
def test_time_and_coverage_may_be_turned_round(masks: np.ndarray) -> None:
    after = np.stack(cleaned(list(masks)))
    np.testing.assert_array_equal(np.stack(cleaned(list(masks[::-1])))[::-1], after)
    np.testing.assert_array_equal(255 - np.stack(cleaned(list(255 - masks))), after)


def test_only_a_few_masks_are_held() -> None:
    drawn = 0

    def masks() -> Iterator[np.ndarray]:
        nonlocal drawn
        for time in range(30):
            drawn += 1
            yield np.full((8, 8), time, np.uint8)

    for time, _ in enumerate(clean_masks(masks())):
        assert drawn <= time + 1 + LONGEST


def test_masks_of_different_sizes_are_refused() -> None:
    with pytest.raises(DynhairError, match="5 x 4 after one of 6 x 4"):
        cleaned([np.zeros((4, 6), np.uint8), np.zeros((4, 5), np.uint8)])
