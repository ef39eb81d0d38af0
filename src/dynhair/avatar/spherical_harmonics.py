"""Real spherical harmonics up to degree 3, for view-dependent colour."""

from __future__ import annotations

import math
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

COEFFICIENTS = 16  # (degree + 1) squared

_C0 = math.sqrt(1 / (4 * math.pi))
_C1 = math.sqrt(3 / (4 * math.pi))
_C2 = math.sqrt(15 / (4 * math.pi))
_C20 = math.sqrt(5 / (16 * math.pi))
_C33 = math.sqrt(35 / (32 * math.pi))
_C32 = math.sqrt(105 / (4 * math.pi))
_C31 = math.sqrt(21 / (32 * math.pi))
_C30 = math.sqrt(7 / (16 * math.pi))


def harmonics_basis(directions: Float[Tensor, "*n 3"]) -> Float[Tensor, "16 *n"]:
    """The sixteen orthonormal real harmonics, ordered by degree l and then by m = -l .. l, Condon-Shortley phase.

    Args:
        directions: unit vectors.
    """
    x, y, z = directions.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    return torch.stack(
        [
            torch.full_like(x, _C0),
            -_C1 * y,
            _C1 * z,
            -_C1 * x,
            _C2 * x * y,
            -_C2 * y * z,
            _C20 * (3 * zz - 1),
            -_C2 * x * z,
            _C2 / 2 * (xx - yy),
            -_C33 * y * (3 * xx - yy),
            _C32 * x * y * z,
            -_C31 * y * (5 * zz - 1),
            _C30 * z * (5 * zz - 3),
            -_C31 * x * (5 * zz - 1),
            _C32 / 2 * z * (xx - yy),
            -_C33 * x * (xx - 3 * yy),
        ]
    )


def harmonics_colours(
    base: Float[Tensor, "1 3 n"], higher: Float[Tensor, "15 3 n"], directions: Float[Tensor, "v n 3"]
) -> Float[Tensor, "v n 3"]:
    """Colours seen along the directions of several views; all-zero coefficients are mid grey, no channel is below 0.

    Args:
        base: coefficients of degree 0 for each channel and point.
        higher: coefficients of degrees 1 to 3.
        directions: unit vectors; they get no gradient, for a colour must not move what it is the colour of.
    """
    sums: Tensor = _HarmonicSum.apply(base, higher, harmonics_basis(directions.detach()))  # pyright: ignore
    return (0.5 + sums).clamp_min(0).movedim(1, 2)


class _HarmonicSum(torch.autograd.Function):
    """Sums of harmonics, all points of a coefficient at once: small products point by point take five times as long."""

    @staticmethod
    def forward(ctx: Any, base: Tensor, higher: Tensor, basis: Tensor) -> Tensor:
        ctx.save_for_backward(basis)
        if basis.is_cuda:  # a few large operations: each has to be launched
            coefficients = torch.cat([base, higher])
            return torch.stack([(coefficients * basis[:, None, view]).sum(0) for view in range(basis.shape[1])])
        views = []
        for view in range(basis.shape[1]):
            values = base[0] * basis[0, view]
            for coefficient, weight in zip(higher, basis[1:, view], strict=True):
                values.addcmul_(coefficient, weight)
            views.append(values)
        return torch.stack(views)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        (basis,) = ctx.saved_tensors
        coefficients = basis[:, :1] * gradients[0][0]
        for view in range(1, basis.shape[1]):
            coefficients.addcmul_(basis[:, None, view], gradients[0][view])
        return coefficients[:1], coefficients[1:], None


def constant_coefficient(colour: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """The degree-0 coefficient that shows ``colour`` from everywhere."""
    return (colour - 0.5) / _C0
