"""Colours without a direction that they are seen from, and in linear light, as scene files have them."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from dynhair.avatar.spherical_harmonics import harmonics_basis


def mean_colours(base: Float[Tensor, "1 3 g"]) -> Float[Tensor, "g 3"]:
    """What harmonics show on average over all directions, sRGB in [0, 1].

    Args:
        base: those of degree 0.
    """
    constant = harmonics_basis(base.new_tensor([0.0, 0.0, 1.0]))[0]
    return (0.5 + constant * base[0].detach().T).clamp(0, 1)


def point_colours(segments: Float[Tensor, "n s 3"]) -> Float[Tensor, "n l 3"]:
    """Colours of strands' segments, at the points between them and at both ends."""
    between = (segments[:, :-1] + segments[:, 1:]) / 2
    return torch.cat([segments[:, :1], between, segments[:, -1:]], 1)


def linear_colours(colours: Float[np.ndarray, "*n 3"]) -> Float32[np.ndarray, "*n 3"]:
    """Turn sRGB in [0, 1] into linear light of the same primaries (IEC 61966-2-1)."""
    bright = ((colours + 0.055) / 1.055) ** 2.4
    return np.where(colours <= 0.04045, colours / 12.92, bright).astype(np.float32)
