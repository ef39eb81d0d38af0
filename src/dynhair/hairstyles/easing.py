"""Soft transitions."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor


def smoothstep(x: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """From 0 (for x <= 0) to 1 (for x >= 1) with level ends."""
    x = x.clamp(0, 1)
    return x * x * (3 - 2 * x)
