"""Metrics against scikit-image, SciPy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from scipy.spatial.distance import jaccard
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torch import Tensor

from dynhair.evaluation.metrics import (
    PSNR_CEILING,
    decibels,
    label_error,
    psnr,
    silhouette,
    silhouette_iou,
    squared_error,
    ssim,
)


def pair_of_images(seed: int, views: int = 2) -> tuple[Tensor, Tensor]:
    generator = np.random.default_rng(seed)
    truth = gaussian_filter(generator.random((views, 31, 37, 3)), (0, 2, 2, 0))
    truth = (truth - truth.min()) / np.ptp(truth)
    images = (truth + generator.normal(0.0, 0.1, truth.shape)).clip(0.0, 1.0)
    return torch.from_numpy(images), torch.from_numpy(truth)


def regions(seed: int, views: int = 2) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).random((views, 31, 37)) < 0.3)


def skimage_ssim(image: Tensor, truth: Tensor) -> tuple[float, np.ndarray]:
    """The mean, which leaves out the border, and the map."""
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    found = structural_similarity(image.numpy(), truth.numpy(), data_range=1.0, channel_axis=-1, full=True, **options)
    return found[0], found[1]


def test_psnr_equals_scikit_image() -> None:
    images, truth = pair_of_images(0)
    expected = [
        peak_signal_noise_ratio(t.numpy(), i.numpy(), data_range=1.0) for i, t in zip(images, truth, strict=True)
    ]
    np.testing.assert_allclose(psnr(images, truth), expected, rtol=1e-12)


def test_psnr_of_a_region_sees_its_pixels_alone() -> None:
    images, truth = pair_of_images(1)
    region = regions(2)
    expected = [
        peak_signal_noise_ratio(t[r].numpy(), i[r].numpy(), data_range=1.0)
        for i, t, r in zip(images, truth, region, strict=True)
    ]
    np.testing.assert_allclose(psnr(images, truth, region), expected, rtol=1e-12)


@pytest.mark.parametrize(("error", "expected"), [(0.1, 20.0), (0.01, 40.0), (1.0, 0.0)])
def test_psnr_of_a_uniform_error(error: float, expected: float) -> None:
    truth = torch.zeros(1, 12, 12, 3, dtype=torch.float64)
    assert psnr(truth + error, truth).item() == pytest.approx(expected)


def test_psnr_is_decibels_of_the_squared_error() -> None:
    images, truth = pair_of_images(9)
    np.testing.assert_allclose(squared_error(images, truth), ((images - truth) ** 2).mean(-1), rtol=1e-12)
    assert torch.equal(decibels(squared_error(images, truth), regions(2)), psnr(images, truth, regions(2)))


def test_label_error_is_a_mean_absolute_error() -> None:
    generator = np.random.default_rng(0)
    first, second = generator.random((2, 2, 31, 37))
    region = regions(2)
    expected = [np.abs(a[r] - b[r]).mean() for a, b, r in zip(first, second, region.numpy(), strict=True)]
    found = label_error(torch.from_numpy(first), torch.from_numpy(second), region)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_identical_images_score_the_ceiling_and_full_similarity() -> None:
    images, _ = pair_of_images(3)
    assert psnr(images, images).tolist() == [PSNR_CEILING] * 2
    np.testing.assert_allclose(ssim(images, images), 1.0, rtol=1e-12)


def test_ssim_equals_scikit_image() -> None:
    images, truth = pair_of_images(4)
    expected = [skimage_ssim(i, t)[0] for i, t in zip(images, truth, strict=True)]
    np.testing.assert_allclose(ssim(images, truth), expected, rtol=1e-9)


def test_ssim_of_a_region_averages_the_map_of_whole_images_off_the_border() -> None:
    images, truth = pair_of_images(5)
    region = regions(6)
    inner = (slice(5, -5), slice(5, -5))
    expected = [
        skimage_ssim(i, t)[1][inner][r[inner].numpy()].mean() for i, t, r in zip(images, truth, region, strict=True)
    ]
    np.testing.assert_allclose(ssim(images, truth, region), expected, rtol=1e-9)


@given(st.integers(0, 1000), st.floats(0.05, 0.95))
def test_iou_is_one_minus_the_jaccard_distance(seed: int, density: float) -> None:
    generator = np.random.default_rng(seed)
    first, second = generator.random((2, 1, 9, 11)) < density
    value = silhouette_iou(torch.from_numpy(first), torch.from_numpy(second))
    assert value.item() == pytest.approx(1.0 - jaccard(first.ravel(), second.ravel()))
    torch.testing.assert_close(value, silhouette_iou(torch.from_numpy(second), torch.from_numpy(first)))


def test_iou_of_shifted_rectangles() -> None:
    first, second = torch.zeros(2, 1, 10, 20, dtype=torch.bool)
    first[:, 2:8, 0:10] = True
    second[:, 2:8, 5:15] = True
    assert silhouette_iou(first, second).item() == pytest.approx(1 / 3)
    assert silhouette_iou(first, first).item() == 1.0
    assert silhouette_iou(first, ~first).item() == 0.0


def test_an_empty_region_is_not_measured() -> None:
    images, truth = pair_of_images(7)
    region = regions(8)
    region[1] = False
    for values in (
        psnr(images, truth, region),
        ssim(images, truth, region),
        silhouette_iou(region, region),
        label_error(images[..., 0], truth[..., 0], region),
    ):
        assert values.isnan().tolist() == [False, True]


def test_half_covered_pixels_are_outside_the_silhouette() -> None:
    coverage = torch.tensor([[[0.0, 0.5, 0.50001, 1.0]]])
    assert silhouette(coverage).tolist() == [[[False, False, True, True]]]
