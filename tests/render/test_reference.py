"""The reference itself, against what can be known without it."""

from __future__ import annotations

import torch
from gaussian_scenes import NAMES, camera, leaves, random_gaussians
from scipy.spatial.transform import Rotation

from dynhair.render import Gaussians, rasterize
from dynhair.render.reference import project_gaussians, quaternion_matrix


def test_one_gaussian_is_a_bell_around_its_projection() -> None:
    view = camera(61, 41)
    gaussians = Gaussians(
        means=torch.tensor([[0.02, -0.01, 0.1]]),
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        scales=torch.zeros(1, 3),
        opacities=torch.tensor([0.6]),
        features=torch.tensor([[0.5]]),
    )
    rendering = rasterize(gaussians, view, backend="reference")
    pixel = view.project(gaussians.means)[0][0]
    y, x = torch.meshgrid(torch.arange(41) + 0.5, torch.arange(61) + 0.5, indexing="ij")
    bell = 0.6 * torch.exp(-((x - pixel[0]) ** 2 + (y - pixel[1]) ** 2) / (2 * 0.3))
    bell[bell < 1 / 255] = 0
    torch.testing.assert_close(rendering.alpha[0], bell)
    torch.testing.assert_close(rendering.features[0, ..., 0], 0.5 * bell)


def test_covariances_are_those_of_projected_samples() -> None:
    """Small Gaussians: their samples, projected exactly, spread as the linearised projection says."""
    generator = torch.Generator().manual_seed(0)
    gaussians, view = leaves(random_gaussians(5, 1), torch.float64), camera().to(dtype=torch.float64)
    scales = 0.02 * gaussians.scales
    axes = quaternion_matrix(gaussians.quats) * scales[:, None]
    normal = torch.randn(200_000, 3, generator=generator, dtype=torch.float64)
    _, covariances, _ = project_gaussians(gaussians.means, gaussians.quats, scales, view)
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
