"""Real spherical harmonics up to degree 3, for view-dependent colour."""

from __future__ import annotations

import math

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


def harmonics_basis(directions: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 16"]:
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
        ],
        -1,
    )


def harmonics_colour(coefficients: Float[Tensor, "n 16 3"], directions: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
    """Colours seen along the unit directions; all-zero coefficients are mid grey, and no channel goes below 0."""
    weights = harmonics_basis(directions)
    return (0.5 + torch.einsum("nk,nkc->nc", weights, coefficients)).clamp_min(0)


def constant_coefficient(colour: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """The degree-0 coefficient that shows ``colour`` from everywhere."""
    return (colour - 0.5) / _C0
