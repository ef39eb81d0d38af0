"""The networks of the prior, and the sparse product that they read volumes with."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from dynhair.prior.encoders import LEADING, SAMPLES, CoarseEncoder, EncoderSizes, FineEncoder
from dynhair.prior.evidence import CHANNELS, GRID, HIGHEST, LOWEST
from dynhair.prior.sampling import sample_volume
from dynhair.strands.scalp_map import directions, texel_uv

TINY = EncoderSizes(volume=4, code=8, texture=8, point=4)
SIZE = 8
ROOTS = directions(texel_uv(SIZE)).float()
TEXELS = torch.arange(5, 50, 2)


def random_strands(batch: int) -> Tensor:
    strands = torch.rand(batch, len(TEXELS), SAMPLES, 3) - 0.5
    return strands.cumsum(2)


@pytest.fixture
def coarse() -> CoarseEncoder:
    torch.manual_seed(0)
    return CoarseEncoder(ROOTS, TINY)


def test_sampling_is_that_of_grid_sample_with_its_gradient() -> None:
    torch.manual_seed(1)
    volume = torch.rand(2, 5, 6, 10, 7, requires_grad=True)
    low, high = torch.tensor(LOWEST), torch.tensor(HIGHEST)
    points = low + (1.2 * torch.rand(2, 200, 3) - 0.1) * (high - low)
    places = ((points - low) / (high - low) * 2 - 1)[:, None, None]
    expected = functional.grid_sample(volume, places, padding_mode="border", align_corners=False)[:, :, 0, 0].mT
    found = sample_volume(volume, points)
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)
    upstream = torch.rand_like(expected)
    gradients = [torch.autograd.grad((read * upstream).sum(), volume)[0] for read in (found, expected)]
    torch.testing.assert_close(*gradients, atol=1e-5, rtol=1e-5)


def test_untrained_networks_predict_the_mean(coarse: CoarseEncoder) -> None:
    volume = torch.rand(2, CHANNELS, *GRID)
    leading, texture, features = coarse(volume)
    assert leading.shape == (2, LEADING, SIZE, SIZE)
    assert features.shape[2:] == (GRID[0] // 2, GRID[1] // 2, GRID[2] // 2)
    start = torch.zeros(2, 20, SIZE, SIZE)
    fine = FineEncoder(20, TINY)(volume, features, texture, start, random_strands(2), TEXELS)
    assert fine.shape == (2, 20, SIZE, SIZE)
    assert not leading.any()
    assert not fine.any()


def test_every_parameter_learns(coarse: CoarseEncoder) -> None:
    fine = FineEncoder(20, TINY)
    networks = torch.nn.ModuleList([coarse, fine])
    optimizer = torch.optim.SGD(networks.parameters(), lr=1e-2)
    target = torch.randn(1, 20, SIZE, SIZE)
    strands, volume = random_strands(1), torch.rand(1, CHANNELS, *GRID)
    touched = dict.fromkeys((name for name, _ in networks.named_parameters()), False)
    # Layers before one that begins at zero have no gradient until it has moved.
    for _ in range(4):
        leading, texture, features = coarse(volume)
        start = functional.pad(leading, (0, 0, 0, 0, 0, 10))
        refined = start + fine(volume, features, texture, start, strands, TEXELS)
        optimizer.zero_grad()
        (refined - target).square().mean().backward()
        for name, parameter in networks.named_parameters():
            assert parameter.grad is not None
            touched[name] |= bool(parameter.grad.any())
        optimizer.step()
    assert all(touched.values()), [name for name, moved in touched.items() if not moved]


def test_texels_read_the_evidence_above_them(coarse: CoarseEncoder) -> None:
    """A change of the evidence at the left of the head moves the texels there first."""
    torch.nn.init.normal_(coarse.head.weight)
    volume = torch.zeros(1, CHANNELS, *GRID)
    changed = volume.clone()
    changed[..., 30:34, 16:19] = 1.0
    with torch.no_grad():
        moved = (coarse(changed)[0] - coarse(volume)[0]).abs().sum(1)[0]
    assert moved[:, SIZE // 2 :].mean() > moved[:, : SIZE // 2].mean()
