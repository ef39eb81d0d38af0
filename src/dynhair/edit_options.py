"""What a user asks of ``dynhair edit``; light to import, as the command line reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import arg


@dataclass(frozen=True)
class EditOptions:
    """Edits to take back, and new ones.

    Attributes:
        brightness: Factor on the hair's colours.
        tint: Colour whose hue and saturation the hair is to have: R,G,B in [0, 1], or #rrggbb.
        tint_strength: From 0 to 1.
        trim: Share of each strand's length to keep.
        longest: Metres to which longer strands are cut.
        length_of: Region to whose median length longer strands are cut.
        thin: Share of the strands to keep.
        width: Factor on the strands' width.
        region: Strands that are edited: all, front (or fringe), top, left, right, sides, back,
            box:x0,x1,y0,y1,z0,z1, sphere:x,y,z,radius (head frame, metres), ids:1,5-20 or ids:FILE.
        list_only: List the edits, and do nothing else.
        undo: How many of the last edits to take back, before the new ones.
        clear: Take all edits back, before the new ones.
    """

    brightness: float | None = None
    tint: str | None = None
    tint_strength: float = 1.0
    trim: float | None = None
    longest: float | None = None
    length_of: str | None = None
    thin: float | None = None
    width: float | None = None
    region: str = "all"
    list_only: Annotated[bool, arg(name="list")] = False
    undo: int = 0
    clear: bool = False
