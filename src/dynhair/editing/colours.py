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

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of the channels, as light, in luminance (ITU-R BT.709)."""

GAMMA = 2.2
"""Of sRGB, nearly: light is a channel to this power."""

_HEADROOM = 2.0  # standard deviations over all directions that a tinted colour has room for below 1


class Harmonics(NamedTuple):
    """Coefficients of degree 0, and of degrees 1 to 3."""

    base: Float[Tensor, "1 3 s"]
    higher: Float[Tensor, "15 3 s"]


def brightened(colours: Harmonics, factor: float) -> Harmonics:
    """Scale the colours (paper, supplement, "Hairstyle color": ``c <- alpha c``)."""
    return Harmonics(factor * (colours.base + 0.5 / Y00) - 0.5 / Y00, factor * colours.higher)


def lightness(colours: Float[Tensor, "3 *s"]) -> Float[Tensor, "*s"]:
    """The grey of a colour's luminance: a mean of the channels, to the power of `GAMMA`."""
    return torch.tensordot(colours.new_tensor(LUMINANCE), colours.clamp_min(0) ** GAMMA, 1) ** (1 / GAMMA)


def tinted(colours: Harmonics, tint: Float[Tensor, "3"], strength: float) -> Harmonics:
    """Give the colours the tint's hue and saturation, and leave each its luminance, from wherever it is seen.

    A colour of the lightness ``y`` becomes ``y`` times the tint over the tint's own lightness. Light hair cannot be as
    saturated as a strong tint: where that would take a channel beyond 1, the tint is mixed with grey. Lightness is
    linear in a colour's scale; where hue varies with the view, its derivative at the mean colour is taken.

    Args:
        colours: of segments.
        tint: sRGB in [0, 1]; a grey takes the colour away, and so does black.
        strength: 0 leaves the colours as they are, 1 replaces them.
    """
    mean = (0.5 + Y00 * colours.base[0]).clamp_min(0)
    light = lightness(mean).clamp_min(1e-6)
    gradient = tint.new_tensor(LUMINANCE)[:, None] * (mean / light) ** (GAMMA - 1)
    varying = (gradient * colours.higher).sum(1, keepdim=True)
    # harmonics are orthonormal: their squares add up to the variance over the sphere's 4 pi
    brightest = light + _HEADROOM * Y00 * varying.norm(dim=0)[0]

    # as light, so that any mixture has the same luminance
    grey = torch.ones_like(tint)[:, None]
    pure = grey if lightness(tint) < 1e-3 else (tint[:, None] / lightness(tint)) ** GAMMA
    room = (brightest.clamp(1e-3, 1) ** -GAMMA - 1) / (pure.max() - 1).clamp_min(1e-6)
    hue = torch.lerp(grey, pure, room.clamp_max(1)) ** (1 / GAMMA)
    full = Harmonics((light * hue - 0.5)[None] / Y00, varying * hue)
    return Harmonics(*(torch.lerp(old, new, strength) for old, new in zip(colours, full, strict=True)))
