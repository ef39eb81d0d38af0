"""The rasterizer on CUDA: gsplat, called with this project's conventions."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool
from torch import Tensor

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.render.gaussians import Gaussians, Rendering


def rasterize_cuda(gaussians: Gaussians, cameras: Sequence[Camera]) -> Rendering:
    """Render over black in float32; see :func:`dynhair.render.rasterize`."""
    try:
        from gsplat import rasterization  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise DynhairError(
            "rendering on CUDA needs gsplat, which is not installed",
            expected="gsplat 1.5.3",
            mend="pip install 'dynhair[cuda]', or pass backend='cpu'",
        ) from error

    means, quats, scales, opacities, features = _without_invalid(gaussians)
    device, bottom = means.device, means.new_tensor([[0.0, 0.0, 0.0, 1.0]])
    colors, alphas, _ = rasterization(
        means=means,
        quats=quats,
        scales=scales,
        opacities=opacities,
        colors=features,
        viewmats=torch.stack([torch.cat([camera.w2c.to(device, torch.float32), bottom]) for camera in cameras]),
        Ks=torch.stack([camera.K.to(device, torch.float32) for camera in cameras]),
        width=cameras[0].width,
        height=cameras[0].height,
        near_plane=0.01,
        eps2d=0.3,
        packed=False,
        render_mode="RGB+ED",
        rasterize_mode="antialiased",
    )
    return Rendering(features=colors[..., :-1], alpha=alphas[..., 0], depth=colors[..., -1])


def _without_invalid(gaussians: Gaussians) -> tuple[Tensor, ...]:
    """Bring attributes to float32 and make Gaussians that cannot be drawn harmless and invisible."""
    valid = _valid(gaussians)
    identity = torch.tensor([1.0, 0.0, 0.0, 0.0], device=valid.device)
    each = valid[:, None]
    return (
        torch.where(each, gaussians.means.float(), 0.0),
        torch.where(each, gaussians.quats.float(), identity),
        torch.where(each, gaussians.scales.float(), 0.0),
        torch.where(valid, gaussians.opacities.float(), 0.0),
        torch.where(each, gaussians.features.float(), 0.0),
    )


def _valid(gaussians: Gaussians) -> Bool[Tensor, " n"]:
    features = gaussians.features
    rows = [gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities[:, None]]
    rows += [features] if features.ndim == 2 else list(features)
    return torch.isfinite(torch.cat(rows, dim=1)).all(dim=1) & gaussians.quats.any(dim=1)
