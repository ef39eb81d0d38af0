"""Positional encoding of coordinates and signals."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

CANONICAL_UNIT = 0.1
"""Metres; positions and translations of heads are encoded in this unit, about the paper's canonical one."""

ENCODING_FREQUENCIES = 4
"""Octaves that they are encoded with."""


def positional_encoding(x: Float[Tensor, "*n d"], frequencies: int) -> Float[Tensor, "*n e"]:
    """The identity followed by sine and cosine at 2^0 .. 2^(frequencies - 1), without a factor of pi.

    Args:
        x: values, of the order of one.
        frequencies: the number of octaves.

    Returns:
        ``d * (1 + 2 * frequencies)`` numbers for every ``d``.
    """
    octaves = 2.0 ** torch.arange(frequencies, dtype=x.dtype, device=x.device)
    angles = (x[..., None, :] * octaves[:, None]).flatten(-2)
    return torch.cat([x, angles.sin(), angles.cos()], -1)


def encoded_size(values: int, frequencies: int) -> int:
    """The length of the encoding of ``values`` numbers."""
    return values * (1 + 2 * frequencies)
