"""Motion of edges against known translations, and against scikit-image's registration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import fourier_shift, gaussian_filter
from skimage.registration import phase_cross_correlation

from dynhair.evaluation.edge_motion import FURTHEST, EdgeMotion

SIZE = (72, 96)


def translated(image: np.ndarray, down: float, right: float) -> np.ndarray:
    """Periodic: exact for any shift."""
    spectrum = np.fft.fftn(image, axes=(0, 1))
    channels = [fourier_shift(spectrum[..., c], (down, right)) for c in range(3)]
    return np.fft.ifftn(np.stack(channels, axis=-1), axes=(0, 1)).real.astype(np.float32)


def texture(seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, 1.0, SIZE)
    smooth = gaussian_filter(noise, 2.0, mode="wrap")
    grey = 0.5 + 0.15 * smooth / smooth.std()
    return np.repeat(grey[..., None], 3, axis=2).astype(np.float32)


def stripes(period: float = 12.0) -> np.ndarray:
    """Horizontal, as on a jersey."""
    rows = 0.5 + 0.3 * np.sin(2 * np.pi * np.arange(SIZE[0]) / period)
    return np.repeat(np.repeat(rows[:, None, None], SIZE[1], axis=1), 3, axis=2).astype(np.float32)


def inner_mean(distances: np.ndarray) -> float:
    return float(np.nanmean(distances[8:-8, 8:-8]))


@pytest.mark.parametrize("shift", [0.0, 0.05, 0.2, -0.5, 1.3, 2.5])
def test_stripes_move_by_their_shift(shift: float) -> None:
    first = stripes()
    assert inner_mean(EdgeMotion(first).distances(translated(first, shift, 0.0))) == pytest.approx(
        abs(shift), rel=0.02, abs=0.005
    )


@pytest.mark.parametrize("shift", [0.2, 1.0])
def test_along_stripes_nothing_moves(shift: float) -> None:
    first = stripes()
    assert inner_mean(EdgeMotion(first).distances(translated(first, 0.0, shift))) < 0.01


@given(st.integers(0, 1000), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_texture_moves_by_its_shift_across_each_edge(seed: int, down: float, right: float) -> None:
    first = texture(seed)
    edges = EdgeMotion(first)
    gy, gx = np.gradient(gaussian_filter(first[..., 0], 1.0, mode="mirror"))
    expected = np.abs(down * gy + right * gx) / np.maximum(np.hypot(gx, gy), 1e-9)
    inner = edges.edges.copy()
    inner[:10] = inner[-10:] = inner[:, :10] = inner[:, -10:] = False
    found = edges.distances(translated(first, down, right))[inner]
    assert np.abs(found - expected[inner]).mean() < 0.06
    assert found.mean() == pytest.approx(expected[inner].mean(), rel=0.05, abs=0.005)


def test_its_mean_agrees_with_registration_of_the_whole_image() -> None:
    first = texture(4)
    second = translated(first, 0.37, 0.0)
    shift, _, _ = phase_cross_correlation(second[..., 0], first[..., 0], upsample_factor=200)
    assert shift[0] == pytest.approx(0.37, abs=0.01)
    edges = EdgeMotion(first)
    upright = np.abs(np.gradient(gaussian_filter(first[..., 0], 1.0), axis=1)) < 0.005  # edges that lie
    found = edges.distances(second)[upright & edges.edges]
    assert np.median(found) == pytest.approx(shift[0], abs=0.03)


def test_a_fifth_of_a_pixel_stands_out_of_noise() -> None:
    generator = np.random.default_rng(5)
    first, noise = texture(6), generator.normal(0.0, 0.01, (2, *SIZE, 3)).astype(np.float32)
    edges = EdgeMotion(first + noise[0])
    resting = inner_mean(edges.distances(first + noise[1]))
    moving = inner_mean(edges.distances(translated(first, 0.2, 0.0) + noise[1]))
    assert resting < 0.05
    assert moving > 2 * resting


def test_a_shadow_is_no_motion() -> None:
    first = texture(7)
    shadow = np.linspace(0.0, 0.1, SIZE[1], dtype=np.float32)[None, :, None]
    assert inner_mean(EdgeMotion(first).distances(first - shadow)) < 0.05


def test_the_same_image_has_not_moved() -> None:
    first = texture(8)
    assert inner_mean(EdgeMotion(first).distances(first)) < 1e-4


def test_an_image_without_edges_has_no_motion() -> None:
    flat = np.full((*SIZE, 3), 0.4, np.float32)
    edges = EdgeMotion(flat)
    assert not edges.edges.any()
    assert np.isnan(edges.distances(texture())).all()


def test_unrelated_images_stay_within_reach() -> None:
    distances = EdgeMotion(texture(9)).distances(texture(10))
    assert np.nanmax(distances) <= FURTHEST
    assert np.nanmin(distances) >= 0.0
