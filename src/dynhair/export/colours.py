"""Colours of scene files, which are linear."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32


def linear_colours(colours: Float[np.ndarray, "*n 3"]) -> Float32[np.ndarray, "*n 3"]:
    """Turn sRGB in [0, 1] into linear light of the same primaries (IEC 61966-2-1)."""
    bright = ((colours + 0.055) / 1.055) ** 2.4
    return np.where(colours <= 0.04045, colours / 12.92, bright).astype(np.float32)
