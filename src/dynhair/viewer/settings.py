"""Everything that the page's controls say, in one moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from dynhair.editing import Brightness, Edit, Thin, Tint, Trim, Width

Display = Literal["image", "splats", "strands"]
DISPLAYS: tuple[Display, ...] = get_args(Display)

Colours = Literal["own", "speed"]
COLOURS: tuple[Colours, ...] = get_args(Colours)

LIVE = "drag the head"
"""In the place of a motion's label: the head goes where it is dragged."""


@dataclass(frozen=True)
class HairEdits:
    """Changes of the whole hairstyle; the defaults change nothing.

    Attributes:
        brightness: factor of the colours.
        tint: that the hair is coloured with, sRGB in 0 to 255.
        tint_strength: how far, 0 to 1.
        trim: part of the length that is cut off, in [0, 1).
        thin: part of the strands that is removed, in [0, 1).
        width: factor of the strands' width.
    """

    brightness: float = 1.0
    tint: tuple[int, int, int] = (150, 40, 60)
    tint_strength: float = 0.0
    trim: float = 0.0
    thin: float = 0.0
    width: float = 1.0

    def edits(self) -> tuple[Edit, ...]:
        """The same as the avatar takes them."""
        red, green, blue = (channel / 255 for channel in self.tint)
        every: tuple[tuple[bool, Edit], ...] = (
            (self.thin > 0, Thin(1 - self.thin)),
            (self.trim > 0, Trim(1 - self.trim)),
            (self.width != 1, Width(self.width)),
            (self.brightness != 1, Brightness(self.brightness)),
            (self.tint_strength > 0, Tint((red, green, blue), self.tint_strength)),
        )
        return tuple(edit for changes, edit in every if changes)


@dataclass(frozen=True)
class Settings:
    """The controls.

    Attributes:
        motion: label of the motion, or :data:`LIVE`.
        speed: of the motion; 1 is the recorded speed.
        rigid: hold the hair in its canonical shape.
        display: who draws what: pictures drawn here, or splats or lines drawn by the browser.
        colours: of the hair: its own, or by its speed.
        expression: what is added to coefficients, by index.
        gravity: its tilt, degrees, see :func:`~dynhair.viewer.motions.tilted`.
        edits: of the hair.
    """

    motion: str
    speed: float = 1.0
    rigid: bool = False
    display: Display = "image"
    colours: Colours = "own"
    expression: tuple[tuple[int, float], ...] = ()
    gravity: tuple[float, float] = (0.0, 0.0)
    edits: HairEdits = HairEdits()
