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
    """Read a volume of any resolution that covers the grid at points in scalp units, trilinearly.

    Points outside of the grid get its border's values. Differentiable in the volume alone. It is the product with a
    sparse matrix of eight weights a point, whose transpose is the backward pass: on a CPU SciPy's takes a fifth of the
    time of ``grid_sample`` and of ``embedding_bag``.
    """
    batch, channels, *dims = volume.shape
    matrix = _weights(points.detach().cpu(), dims)
    table = volume.flatten(2).mT.reshape(-1, channels)
    return _Product.apply(table, matrix).view(batch, -1, channels)  # type: ignore[no-any-return]


def _weights(points: Tensor, dims: list[int]) -> sparse.csr_matrix:
    """The matrix from the voxels of a batch, in the order of flattened volumes, to its points."""
    batch, count = points.shape[:2]
    low, high = torch.tensor(LOWEST), torch.tensor(HIGHEST)
    size = torch.tensor(dims[::-1], dtype=torch.float32)
    places = (points - low).div_(high - low).mul_(size).sub_(0.5)
    places = places.minimum(size - 1).clamp_min_(0)
    corner = places.floor().minimum(size - 2)
    above = places - corner
    stride = torch.tensor([1.0, dims[2], dims[1] * dims[2]])
    first = (corner @ stride).int() + (torch.arange(batch, dtype=torch.int32) * int(size.prod()))[:, None]
    x, y, z = torch.stack([1 - above, above], -1).unbind(2)
    steps = [k * dims[1] * dims[2] + j * dims[2] + i for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    columns = first[..., None] + torch.tensor(steps, dtype=torch.int32)
    values = z[..., :, None, None] * (y[..., :, None] * x[..., None, :])[..., None, :, :]
    rows = np.arange(0, 8 * batch * count + 1, 8, dtype=np.int32)
    shape = (batch * count, batch * int(size.prod()))
    return sparse.csr_matrix((values.flatten().numpy(), columns.flatten().numpy(), rows), shape=shape)


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
