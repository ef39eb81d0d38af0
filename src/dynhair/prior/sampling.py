"""Reading volumes that cover the evidence's grid, at points."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy import sparse
from torch import Tensor

from dynhair.prior.evidence import HIGHEST, LOWEST


def sample_volume(volume: Float[Tensor, "b c d h w"], points: Float[Tensor, "b m 3"]) -> Float[Tensor, "b m c"]:
    """Read a volume of any resolution that covers the grid at points in scalp units, trilinearly; zeros outside.

    Differentiable in the volume alone. It is the product with a sparse matrix of eight weights a point, whose transpose
    is the backward pass: on a CPU SciPy's takes a fifth of the time of ``grid_sample`` and of ``embedding_bag``.
    """
    batch, channels, *dims = volume.shape
    matrix = _weights(points.detach().cpu(), dims)
    table = volume.flatten(2).mT.reshape(-1, channels)
    return _Product.apply(table, matrix).view(batch, -1, channels)  # type: ignore[no-any-return]


def _weights(points: Tensor, dims: list[int]) -> sparse.csr_matrix:
    """The matrix from the voxels of a batch, in the order of flattened volumes, to its points."""
    batch, count = points.shape[:2]
    low, high = torch.tensor(LOWEST), torch.tensor(HIGHEST)
    size = torch.tensor(dims[::-1])
    places = (points - low) / (high - low) * size - 0.5
    corner = places.floor()
    above = places - corner
    at = torch.stack([corner, corner + 1], -1)
    inside = (at >= 0) & (at < size[:, None])
    weight = (torch.stack([1 - above, above], -1) * inside).unbind(2)
    stride = torch.tensor([1, dims[2], dims[1] * dims[2]], dtype=torch.int32)
    offset = (at.clamp_min(0).minimum(size[:, None] - 1).int() * stride[:, None]).unbind(2)
    heads = torch.arange(batch, dtype=torch.int32)[:, None, None] * int(size.prod())
    x, y, z = (weight[0][..., None, None, :], weight[1][..., None, :, None], weight[2][..., :, None, None])
    i, j, k = (offset[0][..., None, None, :], offset[1][..., None, :, None], offset[2][..., :, None, None])
    values = (z * y * x).flatten().numpy()
    columns = (k + j + i + heads[..., None, None]).flatten().numpy()
    rows = np.arange(0, 8 * batch * count + 1, 8, dtype=np.int32)
    return sparse.csr_matrix((values, columns, rows), shape=(batch * count, batch * int(size.prod())))


class _Product(torch.autograd.Function):
    """A sparse constant matrix times a dense one."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, matrix: sparse.csr_matrix) -> Tensor:
        ctx.matrix = matrix
        return torch.from_numpy(matrix @ table.detach().float().cpu().numpy()).to(table)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        (gradient,) = gradients
        return torch.from_numpy(ctx.matrix.T @ gradient.float().cpu().numpy()).to(gradient), None
