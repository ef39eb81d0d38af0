"""The Frechet distance against SciPy's root of a matrix, and its moments against NumPy's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.evaluation.fid import FidSums, Moments, frechet_distance


def samples(seed: int, count: int, width: int) -> np.ndarray:
    """Correlated, and off the origin by much more than they vary."""
    generator = np.random.default_rng(seed)
    return generator.normal(size=(count, width)) @ generator.normal(size=(width, width)) + 100.0


def moments(features: np.ndarray, parts: int = 1) -> Moments:
    sums = Moments(features.shape[1])
    for part in np.array_split(features, parts):
        sums.add(part)
    return sums


def published_formula(first: np.ndarray, second: np.ndarray) -> float:
    """As it is usually computed."""
    covariances = [np.cov(features, rowvar=False) for features in (first, second)]
    root: Any = scipy.linalg.sqrtm(covariances[0] @ covariances[1])
    apart = first.mean(axis=0) - second.mean(axis=0)
    return float(apart @ apart + np.trace(covariances[0] + covariances[1] - 2.0 * root.real))


@pytest.mark.parametrize(("first", "second"), [(40, 40), (25, 300)])
def test_the_distance_is_that_by_the_root_of_a_matrix(first: int, second: int) -> None:
    a, b = samples(0, first, 8), samples(1, second, 8)
    assert frechet_distance(moments(a), moments(b)) == pytest.approx(published_formula(a, b), rel=1e-9)


def test_fewer_samples_than_features_are_no_obstacle() -> None:
    a, b = samples(2, 5, 16), samples(3, 7, 16)
    # the root of a singular matrix is inexact, by about the root of the rounding
    assert frechet_distance(moments(a), moments(b)) == pytest.approx(published_formula(a, b), rel=1e-5)


def test_of_independent_features_it_has_a_closed_form() -> None:
    whitened = np.linalg.qr(np.random.default_rng(0).normal(size=(50, 7)))[0]
    whitened = np.linalg.qr(whitened - whitened.mean(axis=0))[0] * 7.0  # mean 0, covariance 1
    first, second = whitened * np.arange(1, 8), whitened * np.arange(8, 1, -1) + 3.0
    expected = 7 * 3.0**2 + ((np.arange(1, 8) - np.arange(8, 1, -1)) ** 2).sum()
    assert frechet_distance(moments(first), moments(second)) == pytest.approx(expected, rel=1e-12)


@given(st.integers(0, 100), st.integers(1, 40), st.integers(1, 12), st.integers(1, 5))
def test_moments_do_not_depend_on_how_samples_are_split(seed: int, count: int, parts: int, width: int) -> None:
    features = samples(seed, count, width)
    found = moments(features, parts)
    assert found.count == count
    np.testing.assert_allclose(found.mean, features.mean(axis=0), rtol=1e-12)
    assert len(found.deviations) <= max(2 * width, count + parts)
    if count > 1:
        np.testing.assert_allclose(
            found.covariance(), np.atleast_2d(np.cov(features, rowvar=False)), rtol=1e-9, atol=1e-9
        )


def test_memory_is_bounded() -> None:
    found = moments(samples(4, 1000, 6), parts=100)
    assert len(found.deviations) <= 12 + 11
    np.testing.assert_allclose(found.covariance(), np.cov(samples(4, 1000, 6), rowvar=False), rtol=1e-10)


def test_equal_sets_have_no_distance_and_others_the_same_both_ways() -> None:
    a, b = samples(5, 9, 16), samples(6, 9, 16)
    assert frechet_distance(moments(a), moments(a, 3)) == pytest.approx(0.0, abs=1e-9)
    assert frechet_distance(moments(a), moments(b)) == pytest.approx(frechet_distance(moments(b), moments(a)))


def test_sums_of_segments_are_those_of_all_images() -> None:
    images, truth = (torch.from_numpy(samples(seed, 20, 6)).float() for seed in (7, 8))
    whole, first, second = FidSums(6), FidSums(6), FidSums(6)
    whole.add(images, truth)
    first.add(images[:5], truth[:5])
    second.add(images[5:], truth[5:])
    first.merge(second)
    assert first.samples == whole.samples == 20
    assert whole.value() == pytest.approx(published_formula(images.double().numpy(), truth.double().numpy()))
    assert first.value() == pytest.approx(whole.value())


def test_views_that_were_not_seen_are_left_out_of_both() -> None:
    images, truth = (torch.from_numpy(samples(seed, 10, 4)) for seed in (9, 10))
    expected = FidSums(4)
    expected.add(images[2:], truth[2:])
    images[0], truth[1, 2] = torch.nan, torch.nan
    found = FidSums(4)
    found.add(images, truth)
    assert found.samples == 8
    assert found.value() == expected.value()


def test_one_image_has_no_distance() -> None:
    sums = FidSums(4)
    assert sums.value() is None
    sums.add(torch.zeros(1, 4), torch.zeros(1, 4))
    assert sums.value() is None
    sums.add(torch.zeros(1, 4), torch.ones(1, 4))
    assert sums.value() == pytest.approx(0.5**2 * 4 + 4 * 0.5)
