"""A mesh as Gaussians, so that the renderer of Gaussians draws it."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from dynhair.render import Gaussians
from dynhair.render.reference import quaternion_matrix

SPREAD = 2.0
"""Standard deviations of a Gaussian over those of its triangle."""

THICKNESS = 1e-4
"""Metres. The standard deviation along the normal, and the least within the plane."""

OPACITY = 0.99
"""All but opaque: the rasterizer leaves out a Gaussian that would bring the transmittance below 1e-4, and with it a
fully opaque one wherever less than a tenth is still to be covered."""


def triangle_gaussians(
    vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"], colours: Float[Tensor, "f c"]
) -> Gaussians:
    """Put a flat, opaque Gaussian on each triangle, with its centre and its principal axes.

    Means and scales follow the vertices, with the exact gradients of the centre and of the principal standard
    deviations; the axes have no gradient. All is finite for triangles without area or length as well.

    Their silhouette reaches 1.2 to 1.4 pixels beyond that of the mesh, for the rasterizer widens Gaussians to a pixel
    and many lie behind one another there. Drawn twice as fine and averaged, it reaches 0.6 pixels beyond.

    Args:
        vertices: metres.
        faces: triangles, no larger than what is to be seen of the surface.
        colours: of the triangles, any number of channels.

    Returns:
        Gaussians in the order of the faces, their third axes along the normals; ``colours`` are their features.
    """
    corners = vertices.index_select(0, faces.flatten()).reshape(-1, 3, 3)
    means = corners.mean(1)
    arms = corners - means[:, None]
    with torch.no_grad():
        quats = _principal_rotations(arms)
        axes = quaternion_matrix(quats)[:, :, :2]
    # The variance along a principal axis that is held changes as the covariance's eigenvalue does, equal ones included.
    variances = (arms @ axes).square().sum(1) / 12
    within = torch.sqrt(SPREAD**2 * variances + THICKNESS**2)
    return Gaussians(
        means=means,
        quats=quats,
        scales=torch.cat([within, torch.full_like(within[:, :1], THICKNESS)], dim=1),
        opacities=torch.full_like(means[:, 0], OPACITY),
        features=colours,
    )


def _principal_rotations(arms: Float[Tensor, "f 3 3"]) -> Float[Tensor, "f 4"]:
    """Unit quaternions that turn the x axis to each triangle's longer principal axis, and z to its normal.

    First the least turn from z to the normal, or to its opposite if that is nearer, then one about the normal, to
    where the covariance in the plane is diagonal. Both have closed forms. A triangle without area takes any turn.

    Args:
        arms: from the centre to the corners.
    """
    normals = torch.linalg.cross(arms[:, 1] - arms[:, 0], arms[:, 2] - arms[:, 0])
    x, y, z = normalize(normals, dim=1, eps=torch.finfo(normals.dtype).tiny).unbind(1)
    x, y = torch.where(z < 0, -x, x), torch.where(z < 0, -y, y)
    upright = normalize(torch.stack([1 + z.abs(), -y, x, torch.zeros_like(z)], dim=1), dim=1)

    within = arms @ quaternion_matrix(upright)[:, :, :2]
    moments = within.mT @ within
    angle = torch.atan2(2 * moments[:, 0, 1], moments[:, 0, 0] - moments[:, 1, 1]) / 2
    cosine, sine = torch.cos(angle / 2), torch.sin(angle / 2)
    w, x, y, _ = upright.unbind(1)
    return torch.stack([w * cosine, x * cosine + y * sine, y * cosine - x * sine, w * sine], dim=1)
