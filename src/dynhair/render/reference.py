"""The rasterizer in plain PyTorch: what the fast backends compute, in few words, and what they are tested against.

Every pixel looks at every Gaussian: quadratic, for small scenes only. It works in the dtype of the means.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.render.gaussians import Gaussians, Rendering

DILATION = 0.3  # px^2
NEAR = 0.01  # metres
ALPHA_MIN, ALPHA_MAX = 1 / 255, 0.999
TRANSMITTANCE_MIN = 1e-4
FIELD_OF_VIEW_MARGIN = 0.3
PIXELS_AT_ONCE = 1024


def rasterize_reference(gaussians: Gaussians, cameras: Sequence[Camera]) -> Rendering:
    """Render over black; see :func:`dynhair.render.rasterize`."""
    features = gaussians.features
    views = [
        _render_view(gaussians, features if features.ndim == 2 else features[view], camera)
        for view, camera in enumerate(cameras)
    ]
    images, alphas, depths = (torch.stack(part) for part in zip(*views, strict=True))
    return Rendering(images, alphas, depths)


def _render_view(gaussians: Gaussians, features: Tensor, camera: Camera) -> tuple[Tensor, Tensor, Tensor]:
    camera = camera.to(gaussians.means.device, gaussians.means.dtype)
    drawn = _drawable(gaussians, features, camera)
    means, quats, scales = gaussians.means[drawn], gaussians.quats[drawn], gaussians.scales[drawn]
    centres, covariances, shares, depths = project_gaussians(means, quats, scales, camera)
    order = torch.argsort(depths.detach(), stable=True)
    conics = torch.linalg.inv(covariances)[order]
    centres, depths = centres[order], depths[order]
    opacities, features = (gaussians.opacities[drawn] * shares)[order], features[drawn][order]
    blended = torch.cat([depths[:, None], features], dim=1)

    rows = torch.arange(camera.height, dtype=means.dtype, device=means.device) + 0.5
    columns = torch.arange(camera.width, dtype=means.dtype, device=means.device) + 0.5
    pixels = torch.cartesian_prod(rows, columns).flip(-1)
    sums, alphas = [], []
    for some in pixels.split(PIXELS_AT_ONCE):
        offsets = some[:, None] - centres
        power = -0.5 * torch.einsum("pni,nij,pnj->pn", offsets, conics, offsets)
        alpha = (opacities * torch.exp(power)).clamp(max=ALPHA_MAX)
        alpha = torch.where(alpha >= ALPHA_MIN, alpha, 0)
        after = torch.cumprod(1 - alpha, dim=1)
        alpha = torch.where(after > TRANSMITTANCE_MIN, alpha, 0)
        after = torch.cumprod(1 - alpha, dim=1)
        before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], dim=1)[:, : len(centres)]
        weights = alpha * before
        sums.append(weights @ blended)
        alphas.append(weights.sum(dim=1))
    image, alpha = torch.cat(sums), torch.cat(alphas)
    depth = torch.where(alpha > 0, image[:, 0] / torch.where(alpha > 0, alpha, 1), 0)
    size = (camera.height, camera.width)
    return image[:, 1:].reshape(*size, -1), alpha.reshape(size), depth.reshape(size)


def _drawable(gaussians: Gaussians, features: Tensor, camera: Camera) -> Bool[Tensor, " n"]:
    with torch.no_grad():
        attributes = [gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities[:, None], features]
        finite = torch.isfinite(torch.cat(attributes, dim=1)).all(dim=1) & gaussians.quats.any(dim=1)
        return finite & (camera.project(gaussians.means)[1] > NEAR)


def project_gaussians(
    means: Float[Tensor, "n 3"], quats: Float[Tensor, "n 4"], scales: Float[Tensor, "n 3"], camera: Camera
) -> tuple[Float[Tensor, "n 2"], Float[Tensor, "n 2 2"], Float[Tensor, " n"], Float[Tensor, " n"]]:
    """Project Gaussians in front of the camera (3DGS, eq. 5).

    Returns:
        Centres in pixels, dilated covariances in squared pixels, shares of the opacity that a dilated Gaussian keeps
        (the 2D Mip filter of Yu et al. 2024), depths in metres.
    """
    rotation, translation, K = camera.w2c[:, :3], camera.w2c[:, 3], camera.K
    focal, centre = K.diagonal()[:2], K[:2, 2]
    local = means @ rotation.T + translation
    depths = local[:, 2]
    slopes = local[:, :2] / depths[:, None]

    # Off to the side the linearisation blows a Gaussian up without bound; 3DGS takes it at the edge of the view.
    size = torch.tensor([camera.width, camera.height], dtype=means.dtype, device=means.device)
    margin = FIELD_OF_VIEW_MARGIN * size / 2 / focal
    held = slopes.clamp(-centre / focal - margin, (size - centre) / focal + margin)
    jacobian = torch.cat([torch.diag(focal).expand(len(means), 2, 2), -(focal * held)[..., None]], dim=2)
    jacobian = jacobian / depths[:, None, None]

    spread = jacobian @ rotation @ (quaternion_matrix(quats) * scales[:, None, :])
    covariances = spread @ spread.mT + DILATION * torch.eye(2, dtype=means.dtype, device=means.device)
    shares = torch.linalg.cross(*spread.unbind(1)).norm(dim=1) / torch.linalg.det(covariances).sqrt()
    return slopes * focal + centre, covariances, shares, depths


def quaternion_matrix(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Turn quaternions wxyz, not necessarily normalised, into rotation matrices."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=1, eps=0).unbind(1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)
