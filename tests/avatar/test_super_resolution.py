"""Super-resolution: sizes, the start, gradients, and that it learns what interpolation cannot know."""

from __future__ import annotations

import pytest
import torch
from scipy import ndimage
from torch import Tensor
from torch.nn import functional

from dynhair.avatar.super_resolution import SuperResolution
from dynhair.errors import DynhairError


def some_features(*size: int) -> Tensor:
    return torch.rand(size, generator=torch.Generator().manual_seed(1))


def seeded(channels: int, factor: int) -> SuperResolution:
    torch.manual_seed(0)
    return SuperResolution(channels, factor)


@pytest.mark.parametrize("factor", [2, 4, 8])
@pytest.mark.parametrize("channels", [3, 8])
@pytest.mark.parametrize("views", [0, 1, 3])
def test_the_image_grows_by_the_factor(factor: int, channels: int, views: int) -> None:
    image = seeded(channels, factor)(some_features(views, 5, 7, channels))
    assert image.shape == (views, 5 * factor, 7 * factor, 3)


def test_layers_are_those_of_gaussian_head_avatar_by_default() -> None:
    sizes = [tuple(p.shape[:3]) for p in SuperResolution().parameters() if p.ndim == 4]
    expected = [(128, 32, 3), (128, 128, 3), (64, 128, 3), (64, 64, 3), (32, 64, 3), (32, 32, 3), (3, 32, 1)]
    assert sizes == expected


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_it_starts_as_bilinear_interpolation_between_the_centres_of_pixels(factor: int) -> None:
    features = some_features(2, 6, 5, 8)
    expected = ndimage.zoom(features[..., :3].numpy(), (1, factor, factor, 1), order=1, mode="nearest", grid_mode=True)
    with torch.no_grad():
        image = seeded(8, factor)(features)
    torch.testing.assert_close(image, torch.from_numpy(expected), atol=2 / 255, rtol=0)


def test_colours_stay_within_their_range_whatever_the_features() -> None:
    features = torch.cat([some_features(1, 4, 4, 8) * 1e3, -some_features(1, 4, 4, 8) * 1e3])
    network = seeded(8, 2)
    with torch.no_grad():
        network.last.weight.mul_(1e4)
    image = network(features)
    assert image.isfinite().all()
    assert image.min() >= 0
    assert image.max() <= 1


def test_views_do_not_see_each_other() -> None:
    network, features = seeded(4, 4), some_features(3, 4, 6, 4)
    alone = torch.cat([network(view[None]) for view in features])
    torch.testing.assert_close(network(features), alone)


def test_gradients_agree_with_finite_differences() -> None:
    network = seeded(4, 2).double()
    with torch.no_grad():
        network.last.weight.mul_(300)  # so that the convolutions count
    features = (0.1 + 0.8 * some_features(1, 3, 2, 4).double()).requires_grad_()
    assert torch.autograd.gradcheck(network, (features,))


def test_every_parameter_and_feature_has_a_gradient_from_the_start() -> None:
    network, features = seeded(6, 4), some_features(1, 4, 4, 6).requires_grad_()
    loss = (network(features) - 0.2).square().sum()
    for gradient in torch.autograd.grad(loss, [features, *network.parameters()]):
        assert gradient.isfinite().all()
        assert gradient.any()


def test_the_same_seed_gives_the_same_bits() -> None:
    def gradients() -> list[Tensor]:
        network = seeded(8, 4)
        return list(torch.autograd.grad(network(some_features(2, 8, 8, 8)).sum(), list(network.parameters())))

    assert all(torch.equal(a, b) for a, b in zip(gradients(), gradients(), strict=True))


def discs(count: int, size: int, seed: int) -> Tensor:
    """Sharp white discs on black."""
    generator = torch.Generator().manual_seed(seed)
    centres = size * (0.3 + 0.4 * torch.rand(count, 1, 1, 2, generator=generator))
    radii = size * (0.15 + 0.15 * torch.rand(count, 1, 1, generator=generator))
    pixels = torch.stack(torch.meshgrid(*[torch.arange(size) + 0.5] * 2, indexing="ij"), -1)
    inside = ((pixels - centres).square().sum(-1) < radii.square()).float()
    return inside[..., None].expand(-1, -1, -1, 3)


def shrunk(images: Tensor, factor: int) -> Tensor:
    return functional.avg_pool2d(images.permute(0, 3, 1, 2), factor).permute(0, 2, 3, 1)


def test_it_learns_edges_sharper_than_interpolation() -> None:
    network, seen, unseen = seeded(8, 4), discs(8, 48, seed=0), discs(4, 48, seed=1)
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)

    def error(images: Tensor) -> Tensor:
        features = functional.pad(shrunk(images, 4), (0, 5))
        return (network(features) - images).abs().mean()

    interpolated = error(unseen).item()
    for _ in range(60):
        optimizer.zero_grad()
        error(seen).backward()
        optimizer.step()
    assert error(unseen).item() < 0.3 * interpolated


@pytest.mark.parametrize("factor", [-2, 0, 1, 3, 6, 16])
def test_other_factors_are_refused(factor: int) -> None:
    with pytest.raises(DynhairError, match=f"factor of {factor}\nexpected: 2, 4 or 8"):
        SuperResolution(factor=factor)


def test_colours_are_needed() -> None:
    with pytest.raises(DynhairError, match="2 channels\nexpected: 3 or more"):
        SuperResolution(channels=2)
