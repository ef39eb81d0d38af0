"""The rotation group SO(3) and its tangent space."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def cross_matrix(vectors: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """Matrices that take the cross product with vectors: ``cross_matrix(v) @ x = v x x``."""
    x, y, z = vectors.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).unflatten(-1, (3, 3))


def so3_exp(rotation_vectors: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3 3"]:
    """Rotation vectors (axis times angle, radians) to rotation matrices, by Rodrigues' formula."""
    angle = torch.linalg.vector_norm(rotation_vectors, dim=-1)[..., None, None]
    cross = cross_matrix(rotation_vectors)
    # sin(a) / a and (1 - cos(a)) / a^2 as sinc functions: exact at a = 0, without a branch.
    linear = torch.sinc(angle / torch.pi)
    quadratic = 0.5 * torch.sinc(angle / (2 * torch.pi)) ** 2
    identity = torch.eye(3, dtype=rotation_vectors.dtype, device=rotation_vectors.device)
    return identity + linear * cross + quadratic * (cross @ cross)


def so3_log(rotations: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 3"]:
    """Rotation matrices to rotation vectors (axis times angle, radians), with angles in [0, pi].

    It goes through the unit quaternion, so that it is accurate at every angle, 0 and pi included; at pi the sign of the
    axis is arbitrary.
    """
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = rotations.flatten(-2).unbind(-1)
    # Four times the outer product of the quaternion (w, x, y, z) with itself. Each row is a multiple of the quaternion;
    # the row with the largest diagonal entry is the best conditioned.
    outer = torch.stack(
        [
            torch.stack([1 + m00 + m11 + m22, m21 - m12, m02 - m20, m10 - m01], dim=-1),
            torch.stack([m21 - m12, 1 + m00 - m11 - m22, m10 + m01, m20 + m02], dim=-1),
            torch.stack([m02 - m20, m10 + m01, 1 - m00 + m11 - m22, m21 + m12], dim=-1),
            torch.stack([m10 - m01, m20 + m02, m21 + m12, 1 - m00 - m11 + m22], dim=-1),
        ],
        dim=-2,
    )
    best = outer.diagonal(dim1=-2, dim2=-1).argmax(dim=-1)
    quaternion = torch.take_along_dim(outer, best[..., None, None], dim=-2).squeeze(-2)
    quaternion = torch.nn.functional.normalize(quaternion, dim=-1)
    quaternion = torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    w, xyz = quaternion[..., :1], quaternion[..., 1:]
    sine = torch.linalg.vector_norm(xyz, dim=-1, keepdim=True).clamp_min(1e-30)
    return xyz * (2 * torch.atan2(sine, w) / sine)
