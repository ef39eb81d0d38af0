"""Scenes for the rasterizer's tests."""

from __future__ import annotations

import torch
from torch import Tensor

from dynhair.camera import Camera
from dynhair.render import Gaussians, Rendering, rasterize

NAMES = ("means", "quats", "scales", "opacities", "features")


def random_gaussians(n: int, channels: int, seed: int = 0, views: int | None = None) -> Gaussians:
    """About the size of a head, half a metre wide, round and thin ones alike."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    return Gaussians(
        means=0.2 * normal(n, 3),
        quats=normal(n, 4),
        scales=torch.exp(normal(n, 3) - 3.5),
        opacities=torch.rand(n, generator=generator),
        features=torch.rand(*(() if views is None else (views,)), n, channels, generator=generator),
    )


def camera(width: int = 50, height: int = 37, focal: float = 1.2, distance: float = 1.0, turn: float = 0.0) -> Camera:
    """Looks at the origin from ``distance`` metres, turned by ``turn`` radians, its principal point off the centre."""
    c, s = torch.cos(torch.tensor(turn)).item(), torch.sin(torch.tensor(turn)).item()
    w2c = torch.tensor([[c, 0.0, s, 0.02], [0.0, 1.0, 0.0, -0.01], [-s, 0.0, c, distance]])
    K = torch.tensor(
        [[focal * width, 0.0, 0.5 * width + 1.5], [0.0, 1.1 * focal * width, 0.5 * height - 2.0], [0.0, 0.0, 1.0]]
    )
    return Camera(w2c, K, width, height)


def leaves(gaussians: Gaussians, dtype: torch.dtype = torch.float32) -> Gaussians:
    """A copy whose tensors ask for gradients."""
    return Gaussians(*(getattr(gaussians, name).detach().to(dtype, copy=True).requires_grad_() for name in NAMES))


def loss(rendering: Rendering) -> Tensor:
    """Weighs every pixel of the three images differently."""
    generator = torch.Generator().manual_seed(7)
    return sum(
        (image * torch.randn(image.shape, generator=generator).to(image)).sum()
        for image in (rendering.features, rendering.alpha, rendering.depth)
    )  # pyright: ignore[reportReturnType]


def gradients(gaussians: Gaussians) -> dict[str, Tensor]:
    return {name: getattr(gaussians, name).grad for name in NAMES}


def assert_agrees(gaussians: Gaussians, cameras: list[Camera], gradient_tolerance: float = 1e-3) -> None:
    """The CPU's images and gradients are those of the reference in double precision."""
    fast, exact = leaves(gaussians), leaves(gaussians, torch.float64)
    found, expected = rasterize(fast, cameras, backend="cpu"), rasterize(exact, cameras, backend="reference")
    for image in ("features", "alpha", "depth"):
        torch.testing.assert_close(getattr(found, image).double(), getattr(expected, image), atol=1e-4, rtol=0)
    if not found.features.requires_grad:
        return
    loss(found).backward()
    loss(expected).backward()
    for name in NAMES:
        difference = (gradients(fast)[name] - gradients(exact)[name]).norm()
        assert difference <= gradient_tolerance * gradients(exact)[name].norm() + 1e-6, name
