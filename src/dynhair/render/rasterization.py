"""The one entry to rendering: Gaussians and cameras in, images out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.render.gaussians import Gaussians, Rendering

W2C = 12  # numbers of a camera's w2c

Backend = Literal["auto", "cpu", "cuda", "reference"]


def rasterize(
    gaussians: Gaussians,
    cameras: Camera | Sequence[Camera],
    *,
    background: Float[Tensor, " c"] | None = None,
    backend: Backend = "auto",
) -> Rendering:
    """Render Gaussians from one or several cameras (3D Gaussian Splatting, Kerbl et al. 2023).

    Differentiable in the Gaussians' means, quaternions, scales, opacities and features and in the background, through
    all three images; not in the cameras. Any number of feature channels. As in 3DGS, covariances are dilated by
    0.3 px^2, contributions with alpha below 1/255 are skipped, alpha is at most 0.999, a pixel is finished when its
    transmittance would reach 1e-4, what is nearer than 0.01 m is not drawn, and the projection's Jacobian is taken no
    further out than 1.3 times the field of view.

    A dilated Gaussian is made as much fainter as it has become larger (the 2D Mip filter of Yu et al. 2024):
    hair is thinner than a pixel, and would else cover several.

    A Gaussian with a NaN or an infinity in any of its attributes, or with a zero quaternion, is not drawn and its
    gradient is zero.

    Args:
        gaussians: what to draw; features may differ between views.
        cameras: the views, all of one image size.
        background: features behind everything; black if not given.
        backend: ``cpu`` and ``cuda`` are fast and work in float32; ``reference`` is plain PyTorch, slow, in the dtype
            of the means; ``auto`` takes ``cuda`` for CUDA tensors and else ``cpu``.

    Returns:
        Feature, alpha and expected depth images, one for each camera.

    Raises:
        DynhairError: shapes that do not fit, cameras of different sizes or not finite, a backend that is not there.
    """
    cameras = [cameras] if isinstance(cameras, Camera) else list(cameras)
    _check(gaussians, cameras, background)
    if backend == "auto":
        backend = "cuda" if gaussians.means.is_cuda else "cpu"
    if backend == "cpu":
        from dynhair.render.cpu import rasterize_cpu as draw
    elif backend == "cuda":
        from dynhair.render.cuda import rasterize_cuda as draw
    elif backend == "reference":
        from dynhair.render.reference import rasterize_reference as draw
    else:
        raise DynhairError(f"there is no rasterizer {backend!r}", expected="auto, cpu, cuda or reference")

    rendering = draw(gaussians, cameras)
    if background is None:
        return rendering
    behind = (1 - rendering.alpha)[..., None] * background.to(rendering.features)
    return Rendering(rendering.features + behind, rendering.alpha, rendering.depth)


def _check(gaussians: Gaussians, cameras: list[Camera], background: Tensor | None) -> None:
    """Refuse what the kernels could not read safely."""
    if not cameras:
        raise DynhairError("there is no camera to render from", expected="one camera or more")
    sizes = sorted({(camera.width, camera.height) for camera in cameras})
    if len(sizes) > 1:
        raise DynhairError(
            "the cameras have different image sizes: " + ", ".join(f"{w} x {h}" for w, h in sizes),
            expected="one size in a call",
            mend="call rasterize once for each size, or bring the cameras to one size with Camera.resized",
        )
    if min(sizes[0]) < 1:
        raise DynhairError(f"an image of {sizes[0][0]} x {sizes[0][1]} pixels has no pixels")
    # one copy for all: each look at a single number would wait for a GPU
    numbers = torch.stack([torch.cat([camera.w2c.flatten(), camera.K.flatten()]) for camera in cameras]).tolist()
    for index, matrices in enumerate(numbers):
        if not all(map(math.isfinite, matrices)):
            raise DynhairError(f"camera {index} has a NaN or an infinity in w2c or K")
        if not min(matrices[W2C], matrices[W2C + 4]) > 0:
            raise DynhairError(f"camera {index} has a focal length that is not positive")

    n, features = len(gaussians.means), gaussians.features
    expected = {"means": (n, 3), "quats": (n, 4), "scales": (n, 3), "opacities": (n,)}
    for name, shape in expected.items():
        found = tuple(getattr(gaussians, name).shape)
        if found != shape:
            raise DynhairError(f"{name} have the shape {found}", expected=f"{shape}, as there are {n} means")
    if features.ndim not in (2, 3) or features.shape[-2] != n or features.shape[-1] < 1:
        raise DynhairError(f"features have the shape {tuple(features.shape)}", expected=f"({n}, c) or (v, {n}, c)")
    if features.ndim == 3 and len(features) != len(cameras):
        raise DynhairError(f"features are given for {len(features)} views", expected=f"{len(cameras)}, one a camera")
    if background is not None and background.shape != features.shape[-1:]:
        raise DynhairError(
            f"the background has the shape {tuple(background.shape)}", expected=f"({features.shape[-1]},), as features"
        )
