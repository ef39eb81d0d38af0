"""Rotations as quaternions, wxyz."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def rotation_quaternion(rotation_vectors: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 4"]:
    """The unit quaternions, wxyz, of rotation vectors (axis times angle, radians)."""
    half = rotation_vectors / 2
    angle = torch.linalg.vector_norm(half, dim=-1, keepdim=True)
    return torch.cat([angle.cos(), half * torch.sinc(angle / torch.pi)], -1)


def multiply_quaternions(a: Float[Tensor, "*#k 4"], b: Float[Tensor, "k 4"]) -> Float[Tensor, "k 4"]:
    """Hamilton products, wxyz: rotate by ``b``, then by ``a``, one for all or one for each."""
    w, x, y, z = a.unbind(-1)
    left = torch.stack([w, -x, -y, -z, x, w, -z, y, y, z, w, -x, z, -y, x, w], -1).unflatten(-1, (4, 4))
    return b @ left.T if left.ndim == 2 else (left @ b[..., None])[..., 0]
