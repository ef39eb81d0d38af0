"""gsplat's images and gradients against the plain rasterizer in double precision, where there is a GPU."""

from __future__ import annotations

import pytest
import torch
from gaussian_scenes import NAMES, camera, leaves, loss, random_gaussians

from dynhair.render import Gaussians, rasterize

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


def on_gpu(gaussians: Gaussians) -> Gaussians:
    return Gaussians(*(getattr(gaussians, name).detach().cuda().requires_grad_() for name in NAMES))


@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("channels", [1, 3, 8, 13, 32, 40])
def test_agrees_with_the_reference(channels: int, views: int) -> None:
    gaussians = random_gaussians(150, channels, views=None if views == 1 else views)
    cameras = [camera(turn=0.4 * view) for view in range(views)]
    fast, exact = on_gpu(gaussians), leaves(gaussians, torch.float64)
    found, expected = rasterize(fast, cameras), rasterize(exact, cameras, backend="reference")
    for image in ("features", "alpha"):
        torch.testing.assert_close(getattr(found, image).cpu().double(), getattr(expected, image), atol=2e-4, rtol=0)
    seen = expected.alpha > 0.05
    torch.testing.assert_close(found.depth.cpu().double()[seen], expected.depth[seen], atol=1e-3, rtol=1e-3)
    loss(found).backward()
    loss(expected).backward()
    for name in NAMES:
        true = getattr(exact, name).grad
        difference = (getattr(fast, name).grad.cpu().double() - true).norm()
        assert difference <= 5e-3 * true.norm() + 1e-6, name


def test_a_background_and_gaussians_that_cannot_be_drawn() -> None:
    gaussians = random_gaussians(60, 3)
    gaussians.means[3, 1], gaussians.scales[7, 0], gaussians.quats[9] = torch.nan, torch.inf, 0.0
    fast, exact = on_gpu(gaussians), leaves(gaussians, torch.float64)
    behind = torch.tensor([0.2, 0.5, 1.0])
    found = rasterize(fast, camera(), background=behind.cuda())
    expected = rasterize(exact, camera(), background=behind.double(), backend="reference")
    torch.testing.assert_close(found.features.cpu().double(), expected.features, atol=2e-4, rtol=0)
    loss(found).backward()
    for name in NAMES:
        gradient = getattr(fast, name).grad
        assert gradient.isfinite().all(), name
        assert not gradient[..., [3, 7, 9], :].any() if gradient.ndim > 1 else not gradient[[3, 7, 9]].any(), name
