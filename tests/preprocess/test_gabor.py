"""The orientation of drawn lines and textures, against known angles and the plain bank of 180 filters."""

from __future__ import annotations

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from dynhair.preprocess import orientation
from dynhair.preprocess.orientation import gabor_orientation


def bundle(angle: float, *, size: int = 72, spacing: float = 4.4, width: float = 1.6, seed: int = 0) -> np.ndarray:
    """Draw antialiased, parallel lines of random brightness; ``angle`` in units of pi."""
    y, x = np.mgrid[:size, :size] - size / 2
    across = y * np.cos(np.pi * angle) - x * np.sin(np.pi * angle) + 1000 * spacing
    line = np.floor(across / spacing).astype(int)
    distance = np.abs(across - (line + 0.5) * spacing)
    brightness = np.random.default_rng(seed).uniform(0.5, 1, line.max() + 1)[line]
    grey = 40 + 180 * brightness * np.clip((width + 1) / 2 - distance, 0, 1)
    return np.repeat(np.round(grey).astype(np.uint8)[..., None], 3, -1)


def texture(shape: tuple[int, int] = (60, 75), seed: int = 0) -> np.ndarray:
    """Noise, smoothed along the diagonal on one half."""
    noise = np.random.default_rng(seed).uniform(0, 255, (*shape, 3))
    smooth = np.mean([np.roll(noise, (i, i), (0, 1)) for i in range(5)], 0)
    noise[:, : shape[1] // 2] = smooth[:, : shape[1] // 2]
    return noise.astype(np.uint8)


def apart(a: np.ndarray, b: np.ndarray | float) -> np.ndarray:
    """Angle between undirected orientations, degrees."""
    difference = np.abs(a - b) % 1
    return 180 * np.minimum(difference, 1 - difference)


def inner(array: np.ndarray) -> np.ndarray:
    return array[12:-12, 12:-12]


@given(st.floats(0, 1, exclude_max=True))
def test_lines_have_their_angle(angle: float) -> None:
    found, coherence = gabor_orientation(bundle(angle))
    assert apart(inner(found), angle).max() < 2
    assert apart(inner(found), angle).mean() < 0.5
    assert inner(coherence).min() > 0.8


@pytest.mark.parametrize("spacing", [3.2, 6.0, 8.0])
def test_lines_of_other_widths_have_their_angle(spacing: float) -> None:
    found, coherence = gabor_orientation(bundle(0.137, spacing=spacing, width=spacing / 2.7))
    assert apart(inner(found), 0.137).mean() < 2
    assert inner(coherence).mean() > 0.6


def test_single_pixels_agree_with_the_plain_bank() -> None:
    image = texture()
    luma = image @ np.array([0.2989, 0.587, 0.114]) / 255
    fine, coarse = (ndimage.gaussian_filter(luma, sigma, mode="nearest", truncate=4) for sigma in (0.4, 10))
    angles = np.arange(180) / 180
    responses = []
    y, x = np.mgrid[-10:11, -10:11]
    for along in np.pi * angles:
        u, v = x * np.sin(along) - y * np.cos(along), x * np.cos(along) + y * np.sin(along)
        kernel = np.exp(-(u**2) / (2 * 1.8**2) - v**2 / (2 * 2.4**2)) * np.cos(2 * np.pi * 0.23 * u)
        responses.append(np.abs(ndimage.correlate(fine - coarse, kernel, mode="nearest")))
    response = np.stack(responses)
    greatest = response.max(0)
    found, coherence = gabor_orientation(image, pooling=0.0)

    at_found = np.take_along_axis(response, np.round(found * 180).astype(int)[None] % 180, 0)[0]
    assert (at_found / greatest).min() > 0.97  # two peaks may be nearly as high as each other
    clear = (
        np.where(apart(angles[:, None, None], angles[response.argmax(0)]) > 20, response, 0).max(0) < 0.95 * greatest
    )
    error = apart(found, angles[response.argmax(0)])[clear]
    assert error.mean() < 0.4  # a quarter of a degree of it is the steps between the filters
    assert np.quantile(error, 0.98) < 1  # some peaks are all but flat
    mean = np.abs((np.exp(2j * np.pi * angles)[:, None, None] * response).sum(0)) / response.sum(0)
    np.testing.assert_allclose(coherence, np.minimum(mean / 0.83129, 1), atol=0.02)


def test_a_grating_is_fully_coherent() -> None:
    x = np.arange(64) * np.cos(0.3)
    wave = 127.5 + 100 * np.cos(2 * np.pi * 0.23 * (x + np.arange(64)[:, None] * np.sin(0.3)))
    _, coherence = gabor_orientation(np.repeat(np.round(wave).astype(np.uint8)[..., None], 3, -1))
    assert inner(coherence).min() > 0.97


def test_the_map_turns_with_the_image() -> None:
    image = texture()
    angle, coherence = gabor_orientation(image)
    for turned, expected, moved in (
        (np.rot90(image), angle + 0.5, np.rot90),
        (image[:, ::-1], 1 - angle, np.fliplr),
        (image.transpose(1, 0, 2), 0.5 - angle, np.transpose),
    ):
        found, as_coherent = gabor_orientation(np.ascontiguousarray(turned))
        np.testing.assert_allclose(as_coherent, moved(coherence), atol=1e-3)
        assert apart(found, moved(expected))[moved(coherence) > 0.05].max() < 1


def test_noise_is_less_coherent_than_lines_and_less_so_the_more_is_pooled() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    alone, pooled, widely = (gabor_orientation(noise, pooling=pooling)[1].mean() for pooling in (0.0, 2.4, 6.0))
    assert 0.6 > alone > pooled > widely
    assert pooled < 0.5 * gabor_orientation(bundle(0.3))[1].mean()


def test_half_the_contrast_has_the_same_angles() -> None:
    image = bundle(0.81)
    angle, _ = gabor_orientation(image)
    faint, coherence = gabor_orientation(image // 16 + 90)
    assert apart(inner(angle), inner(faint)).max() < 3
    assert inner(coherence).min() > 0.7


@pytest.mark.parametrize("pooling", [0.0, 2.4])
@pytest.mark.parametrize("value", [0, 137, 255])
def test_a_flat_image_is_not_coherent(value: int, pooling: float) -> None:
    angle, coherence = gabor_orientation(np.full((40, 30, 3), value, np.uint8), pooling=pooling)
    assert np.isfinite(angle).all()
    assert coherence.max() < 1e-3


def test_strips_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    image = texture()
    angle, coherence = gabor_orientation(image)
    monkeypatch.setattr(orientation, "STRIP", 7 * image.shape[1])
    in_strips, as_coherent = gabor_orientation(image)
    np.testing.assert_allclose(as_coherent, coherence, atol=1e-4)
    assert apart(in_strips, angle)[coherence > 0.05].max() < 0.1


@given(
    hnp.arrays(np.uint8, st.tuples(st.integers(1, 20), st.integers(1, 20), st.just(3))),
    st.sampled_from([0.0, 1.0, 2.4]),
)
def test_any_image_gives_values_in_range(image: np.ndarray, pooling: float) -> None:
    angle, coherence = gabor_orientation(image, pooling=pooling)
    assert angle.dtype == coherence.dtype == np.float32
    assert angle.shape == coherence.shape == image.shape[:2]
    assert ((angle >= 0) & (angle < 1)).all()
    assert ((coherence >= 0) & (coherence <= 1)).all()
