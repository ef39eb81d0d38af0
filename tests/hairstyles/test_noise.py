"""Random numbers that belong to places."""

from __future__ import annotations

import torch
from scipy.stats import kstest

from dynhair.hairstyles.noise import clumps, hashed, smooth_noise, strand_random


def _points(count: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=torch.Generator().manual_seed(0)), dim=1)


def test_hashes_are_uniform_and_channels_independent():
    cells = torch.cartesian_prod(*[torch.arange(-12, 12)] * 3)
    first, second = hashed(cells, 5, 0), hashed(cells, 5, 1)
    assert kstest(first.numpy(), "uniform").pvalue > 1e-3
    assert abs(torch.corrcoef(torch.stack([first, second]))[0, 1]) < 0.03


def test_hashes_are_the_same_everywhere():
    found = hashed(torch.tensor([[0, 0, 0], [1, -2, 3]]), 42, 7)
    torch.testing.assert_close(found, torch.tensor([0.18385285139083862, 0.05534416437149048]), rtol=0, atol=0)


def test_strands_at_one_place_are_alike_and_others_are_not():
    points = _points(200)
    numbers = strand_random(points, 1, 2)
    assert torch.equal(numbers[::3], strand_random(points[::3], 1, 2))
    assert len(numbers.unique()) > 190


def test_smooth_noise_is_continuous_and_bounded():
    points = _points(500)
    noise = smooth_noise(points, 0.3, 3, 4)
    assert noise.abs().max() <= 1
    assert noise.std() > 0.2
    # Smoothstep's slope of 1.5 over a cell, of values that differ by 2 at most, along each of three axes.
    moved = smooth_noise(points + 1e-3, 0.3, 3, 4)
    assert (moved - noise).abs().max() <= 3 * 2 * 1.5 / 0.3 * 1e-3


def test_a_clump_is_the_nearest_of_all_clumps():
    points = _points(300)
    centres, cells = clumps(points, 0.2, 9, 30)
    own = (centres - points).norm(dim=1)
    assert (torch.cdist(points.double(), centres.double()).amin(1) >= own - 1e-6).all()
    assert 20 < len(torch.unique(cells, dim=0)) < 300
