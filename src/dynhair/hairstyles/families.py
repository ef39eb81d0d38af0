"""Families of hairstyles: distributions over the numbers of a style."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from dynhair.errors import DynhairError
from dynhair.hairstyles.style import Style

# What a number is drawn from: a constant, or the two ends of a uniform distribution.
Range = float | tuple[float, float]

_STRAIGHT: dict[str, Range] = {
    "wave_amplitude": (0.0, 0.002),
    "wave_length": (0.1, 0.2),
    "frizz": (0.0003, 0.0012),
    "clumping": (0.1, 0.5),
}
_WAVY: dict[str, Range] = {
    "wave_amplitude": (0.005, 0.011),
    "wave_length": (0.06, 0.11),
    "curl": (0.1, 0.5),
    "wave_disorder": (0.1, 0.5),
    "frizz": (0.0008, 0.002),
    "clumping": (0.3, 0.7),
    "thickness": (0.012, 0.024),
}
_CURLY: dict[str, Range] = {
    "wave_amplitude": (0.006, 0.011),
    "wave_length": (0.03, 0.05),
    "curl": (0.8, 1.0),
    "wave_start": (0.01, 0.04),
    "wave_disorder": (0.4, 0.9),
    "frizz": (0.001, 0.003),
    "clumping": (0.5, 0.85),
    "clump_size": (0.12, 0.2),
    "thickness": (0.016, 0.03),
    "lift": (0.8, 1.6),
}
_COILY: dict[str, Range] = {
    "wave_amplitude": (0.003, 0.006),
    "wave_length": (0.012, 0.02),
    "curl": (0.9, 1.0),
    "wave_start": (0.004, 0.01),
    "wave_disorder": (0.6, 1.0),
    "frizz": (0.0015, 0.003),
    "clumping": (0.4, 0.8),
    "clump_size": (0.1, 0.18),
    "parted": 0.0,
    "whorl": 1.0,
    "stand": (0.75, 1.0),
    "opening": 0.0,
    "fall": (0.25, 0.7),
    "stiffness": (0.03, 0.06),
    "lift": (0.6, 1.5),
    "hem": 10.0,
}
_MIDDLE: dict[str, Range] = {"parting": (-0.06, 0.06), "sweep": (0.3, 0.8), "fall": (0.08, 0.16)}
_SIDE: dict[str, Range] = {"parting": (0.25, 0.5), "sweep": (0.4, 1.0), "fall": (0.1, 0.18)}
_LONG: dict[str, Range] = {"length": (0.5, 0.75), "hem": (0.3, 0.5), "thickness": (0.008, 0.02)}
_MEDIUM: dict[str, Range] = {"length": (0.3, 0.42), "hem": (0.16, 0.27)}
_BOB: dict[str, Range] = {
    "length": (0.26, 0.32),
    "hem": (0.08, 0.15),
    "thickness": (0.01, 0.022),
    "front": (0.0, 0.08),
    "back": (0.0, 0.05),
}
_TIED: dict[str, Range] = {
    "tied": 1.0,
    "parted": 0.0,
    "hem": 10.0,
    "length": (0.4, 0.6),
    "lift": (0.2, 0.5),
    "thickness": (0.004, 0.009),
    "stiffness": (0.008, 0.015),
    "tie_radius": (0.008, 0.015),
    "length_noise": (0.03, 0.08),
}

_RECIPES: dict[str, dict[str, Range]] = {
    "long_straight_middle": _STRAIGHT | _LONG | _MIDDLE,
    "long_straight_side": _STRAIGHT | _LONG | _SIDE,
    "long_straight_fringe": _STRAIGHT
    | _LONG
    | _MIDDLE
    | {
        "fringe_width": (0.5, 0.75),
        "fringe_depth": (0.4, 0.6),
        "fringe_hem": (-0.005, 0.02),
        "fringe_aside": (-0.3, 0.3),
        "sweep": (0.8, 1.4),
    },
    "long_wavy_middle": _LONG | _WAVY | _MIDDLE,
    "long_layered_side": _LONG
    | _WAVY
    | _SIDE
    | {"length": (0.38, 0.48), "hem": (0.3, 0.45), "wave_amplitude": (0.003, 0.007)},
    "long_curly": _LONG | _CURLY | _MIDDLE | {"parting": (-0.4, 0.4), "length": (0.4, 0.55)},
    "medium_wavy_side": _MEDIUM | _WAVY | _SIDE,
    "medium_straight_back": _STRAIGHT
    | _MEDIUM
    | {"parted": (0.0, 0.15), "sweep": (1.0, 1.5), "fall": (0.18, 0.3), "thickness": (0.008, 0.018)},
    "bob_straight": _STRAIGHT | _BOB | _MIDDLE | {"parting": (-0.45, 0.45), "hem_forward": (-0.1, 0.4)},
    "bob_fringe": _STRAIGHT
    | _BOB
    | _MIDDLE
    | {"fringe_width": (0.55, 0.75), "fringe_depth": (0.35, 0.55), "fringe_hem": (-0.01, 0.015), "sweep": (0.8, 1.4)},
    "bob_wavy_asymmetric": _BOB | _WAVY | _SIDE | {"hem_aslant": (-0.7, -0.3), "wave_amplitude": (0.004, 0.008)},
    "ponytail_low": _STRAIGHT | _TIED | {"tie_height": (-0.45, 0.0), "tie_side": (-0.1, 0.1)},
    "ponytail_wavy": _WAVY
    | _TIED
    | {"tie_height": (0.0, 0.4), "tie_side": (-0.1, 0.1), "wave_start": (0.2, 0.25), "wave_amplitude": (0.004, 0.008)},
    "ponytail_high": _STRAIGHT | _TIED | {"tie_height": (0.6, 1.0), "tail_stand": (0.04, 0.07)},
    "cropped": _STRAIGHT
    | {
        "length": (0.025, 0.06),
        "hem": 10.0,
        "parted": 0.0,
        "whorl": (0.7, 1.0),
        "stand": (0.1, 0.35),
        "opening": 0.0,
        "fall": (0.1, 0.3),
        "thickness": (0.004, 0.012),
        "lift": (0.3, 0.8),
        "length_noise": (0.05, 0.15),
    },
    "undercut": _STRAIGHT
    | {
        "length": (0.06, 0.12),
        "hem": 10.0,
        "parted": (0.0, 0.5),
        "parting": (0.4, 0.5),
        "sweep": (0.8, 1.2),
        "fall": (0.25, 0.4),
        "thickness": (0.008, 0.015),
        "side_length": (0.005, 0.012),
        "side_height": (0.3, 0.6),
        "lift": (0.8, 1.6),
        "length_noise": (0.05, 0.1),
    },
    "short_curly": _CURLY
    | {
        "length": (0.07, 0.13),
        "hem": 10.0,
        "parted": 0.0,
        "whorl": (0.2, 0.6),
        "sweep": (0.3, 0.8),
        "stand": (0.3, 0.6),
        "opening": 0.0,
        "fringe_width": (0.9, 1.1),
        "fringe_depth": (0.3, 0.5),
        "fringe_hem": (-0.02, 0.0),
        "fall": (0.1, 0.16),
        "wave_amplitude": (0.005, 0.008),
        "wave_length": (0.025, 0.04),
    },
    "coily_short": _COILY | {"length": (0.02, 0.045), "thickness": (0.004, 0.01)},
    "coily_volume": _COILY | {"length": (0.05, 0.09), "thickness": (0.01, 0.02)},
}

FAMILIES: tuple[str, ...] = tuple(_RECIPES)
HELD_OUT: tuple[str, ...] = ("long_layered_side", "bob_wavy_asymmetric", "ponytail_high", "coily_volume")

_DRAPES = (
    {"divide": (-0.25, 0.1), "front": (0.2, 0.5), "back": (0.1, 0.25)},
    {"divide": 2.0, "back": (0.15, 0.35)},
    {"divide": (-0.6, -0.3), "front": (0.3, 0.6), "back": (0.1, 0.2)},
)


def random_style(family: str, seed: int) -> Style:
    """Draw a style of a family; from PCG64's uniform numbers, so that a seed gives the same style on any platform.

    Args:
        family: one of :data:`FAMILIES`.
        seed: of the draw, and of all that varies within the style.

    Raises:
        DynhairError: there is no such family.
    """
    if family not in _RECIPES:
        raise DynhairError(f'there is no family of hairstyles "{family}"', expected=f"one of {', '.join(FAMILIES)}")
    random = np.random.Generator(np.random.PCG64([seed, FAMILIES.index(family)]))
    # One number for each field in the order of the fields, and those of the drape: later ones do not depend on whether
    # earlier ones are fixed.
    draws = dict(zip((field.name for field in fields(Style)), random.random(len(fields(Style))), strict=True))
    drape = _DRAPES[int(random.integers(len(_DRAPES)))]
    recipe: dict[str, Range] = drape | _RECIPES[family]
    numbers = {name: _between(bounds, float(draws[name])) for name, bounds in recipe.items()}
    if random.random() < 0.5 and "parting" in numbers:
        for name in ("parting", "hem_aslant", "fringe_aside"):
            if name in numbers:
                numbers[name] = -numbers[name]
    return Style(seed=int(random.integers(1 << 31)), **numbers)


def _between(bounds: Range, share: float) -> float:
    if isinstance(bounds, tuple):
        return bounds[0] + share * (bounds[1] - bounds[0])
    return float(bounds)
