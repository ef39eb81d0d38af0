"""Colours that depend on the view, changed as a whole: linear in the colour, hence exact for its harmonics.

A colour is ``0.5 + sum_k c_k Y_k(direction)``, below 0 cut off. Where each direction's colour is to become ``M`` times
it, so do the coefficients above degree 0, and that of degree 0 as the constant 0.5 demands.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

Y00 = 0.5 / math.sqrt(math.pi)
"""The harmonic of degree 0."""

LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of the channels in a colour's lightness (ITU-R BT.709)."""

_HEADROOM = 2.0  # standard deviations over all directions that a tinted colour has room for below 1


class Harmonics(NamedTuple):
    """Coefficients of degree 0, and of degrees 1 to 3."""

    base: Float[Tensor, "1 3 s"]
    higher: Float[Tensor, "15 3 s"]


def brightened(colours: Harmonics, factor: float) -> Harmonics:
    """Scale the colours (paper, supplement, "Hairstyle color": ``c <- alpha c``)."""
    return Harmonics(factor * (colours.base + 0.5 / Y00) - 0.5 / Y00, factor * colours.higher)


def tinted(colours: Harmonics, tint: Float[Tensor, "3"], strength: float) -> Harmonics:
    """Give the colours the tint's hue and saturation, and leave each its lightness, from wherever it is seen.

    A colour of luma ``y`` becomes ``y`` times the tint over the tint's own luma. Light hair cannot be as saturated as
    a strong tint: where that would take a channel beyond 1, the tint is mixed with grey of the same luma.

    Args:
        colours: of segments.
        tint: sRGB in [0, 1]; a grey takes the colour away, and so does black.
        strength: 0 leaves the colours as they are, 1 replaces them.
    """
    weights = tint.new_tensor(LUMA)
    luma, own = weights @ (0.5 + Y00 * colours.base[0]), weights @ tint
    varying = torch.einsum("c,kcs->ks", weights, colours.higher)
    # harmonics are orthonormal: their squares add up to the variance over the sphere's 4 pi
    brightest = luma.clamp_min(0) + _HEADROOM * Y00 * varying.norm(dim=0)
    pure = torch.ones_like(tint) if own < 1e-3 else tint / own
    room = (1 - brightest) / (brightest * (pure.max() - 1)).clamp_min(1e-6)
    hue = torch.lerp(torch.ones_like(pure)[:, None], pure[:, None], room.clamp(0, 1))
    full = Harmonics(((luma * hue - 0.5) / Y00)[None], varying[:, None] * hue)
    return Harmonics(*(torch.lerp(old, new, strength) for old, new in zip(colours, full, strict=True)))
