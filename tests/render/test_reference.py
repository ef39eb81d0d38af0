"""The reference itself, against what can be known without it."""

from __future__ import annotations

import math

import pytest
import torch
from gaussian_scenes import NAMES, camera, leaves, random_gaussians
from scipy.spatial.transform import Rotation

from dynhair.camera import Camera
from dynhair.render import Gaussians, rasterize
from dynhair.render.reference import project_gaussians, quaternion_matrix


def straight_camera(width: int, height: int) -> Camera:
    """A metre from the origin, looking along z."""
    w2c = torch.tensor([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
    return Camera(w2c, camera(width, height).K, width, height)


def test_one_gaussian_is_a_bell_around_its_projection() -> None:
    view = straight_camera(61, 41)
    gaussians = Gaussians(
        means=torch.tensor([[0.0, 0.0, 0.1]]),
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        scales=torch.tensor([[0.02, 0.01, 0.0]]),
        opacities=torch.tensor([0.6]),
        features=torch.tensor([[0.5]]),
    )
    rendering = rasterize(gaussians, view, backend="reference")
    y, x = torch.meshgrid(torch.arange(41) + 0.5, torch.arange(61) + 0.5, indexing="ij")
    variance_x = (view.K[0, 0] * 0.02 / 1.1) ** 2
    variance_y = (view.K[1, 1] * 0.01 / 1.1) ** 2
    share = torch.sqrt(variance_x * variance_y / ((variance_x + 0.3) * (variance_y + 0.3)))
    power = (x - view.K[0, 2]) ** 2 / (variance_x + 0.3) + (y - view.K[1, 2]) ** 2 / (variance_y + 0.3)
    bell = 0.6 * share * torch.exp(-power / 2)
    bell[bell < 1 / 255] = 0
    torch.testing.assert_close(rendering.alpha[0], bell)
    torch.testing.assert_close(rendering.features[0, ..., 0], 0.5 * bell)


@pytest.mark.parametrize("width", [0.005, 0.01, 0.03])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_what_is_thinner_than_a_pixel_covers_its_own_area(width: float, turn: float) -> None:
    """A needle of 0.1 to 0.7 pixels: dilated to more than a pixel, it covers what it would if it were not."""
    view = straight_camera(50, 50)
    gaussians = Gaussians(
        means=torch.zeros(1, 3),
        quats=torch.tensor([[math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2)]]),
        scales=torch.tensor([[0.1, width / 3, 0.0]]),
        opacities=torch.tensor([0.9]),
        features=torch.ones(1, 1),
    )
    covered = rasterize(leaves(gaussians, torch.float64), view, backend="reference").alpha.sum()
    own = 0.9 * 2 * math.pi * 0.1 * width / 3 * view.K[0, 0] * view.K[1, 1]
    torch.testing.assert_close(covered, own.double(), rtol=0.05, atol=0)


def test_covariances_are_those_of_projected_samples() -> None:
    """Small Gaussians: their samples, projected exactly, spread as the linearised projection says."""
    generator = torch.Generator().manual_seed(0)
    gaussians, view = leaves(random_gaussians(5, 1), torch.float64), camera().to(dtype=torch.float64)
    scales = 0.02 * gaussians.scales
    axes = quaternion_matrix(gaussians.quats) * scales[:, None]
    normal = torch.randn(200_000, 3, generator=generator, dtype=torch.float64)
    _, covariances, _, _ = project_gaussians(gaussians.means, gaussians.quats, scales, view)
    for mean, axis, covariance in zip(gaussians.means, axes, covariances, strict=True):
        pixels, _ = view.project(mean + normal @ axis.T)
        spread = torch.cov(pixels.T) + 0.3 * torch.eye(2, dtype=torch.float64)
        torch.testing.assert_close(spread, covariance, rtol=0.02, atol=1e-4)


def test_quaternions_are_scipys() -> None:
    quats = random_gaussians(20, 1).quats.double()
    expected = Rotation.from_quat(quats.numpy(), scalar_first=True).as_matrix()
    torch.testing.assert_close(quaternion_matrix(quats), torch.from_numpy(expected))


def test_gradients_are_finite_differences() -> None:
    gaussians = leaves(random_gaussians(6, 2), torch.float64)

    def images(*tensors: torch.Tensor) -> tuple[torch.Tensor, ...]:
        rendering = rasterize(Gaussians(*tensors), camera(9, 7), backend="reference")
        return rendering.features, rendering.alpha

    assert torch.autograd.gradcheck(images, tuple(getattr(gaussians, name) for name in NAMES))
