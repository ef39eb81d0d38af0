"""Regions of a hairstyle: strands chosen by where they are rooted, or by number.

Roots are those of the canonical hair, in the head frame: x to the subject's left, y up, z out of the face, metres. They
are the same in every frame and under every edit, and so are the strands that a region holds.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.errors import DynhairError

WHOLE = "all"
EXPECTED = (
    "all, front (or fringe), top, left, right, sides, back, box:x0,x1,y0,y1,z0,z1, sphere:x,y,z,radius, "
    "ids:1,5-20 or ids:FILE"
)

TOP = math.radians(60)
"""Elevation above which a root is on top of the head."""

TEMPLE, EAR = math.radians(30), math.radians(115)
"""Azimuths from the face's at which the front ends, and behind the ear at which the back begins."""


@dataclass(frozen=True)
class NamedRegion:
    """A part of the head as a hairdresser sections it.

    The centre of the head is taken to lie amid the roots, as far below the uppermost one as they reach to the sides on
    average. Seen from there, ``top`` is what is higher than `TOP`. Below, ``front`` (or ``fringe``) is what lies within
    `TEMPLE` of +z by azimuth, ``back`` what lies beyond `EAR`, and between them are ``left``, the subject's, towards +x
    and ``right`` towards -x. Every strand is in exactly one of these five. ``sides`` is left and right, ``all``
    everything.
    """

    name: str

    def select(self, roots: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """Which strands it holds."""
        low, high = roots.amin(0), roots.amax(0)
        centre = (low + high) / 2
        centre[1] = high[1] - (high - low)[[0, 2]].mean() / 2
        x, y, z = (roots - centre).unbind(1)
        top = torch.atan2(y, torch.hypot(x, z)) > TOP
        return _SECTIONS[self.name](top, torch.atan2(x, z))

    def __str__(self) -> str:
        return self.name


_SECTIONS: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    WHOLE: lambda top, azimuth: torch.ones_like(top),
    "top": lambda top, azimuth: top,
    "front": lambda top, azimuth: ~top & (azimuth.abs() < TEMPLE),
    "left": lambda top, azimuth: ~top & (azimuth >= TEMPLE) & (azimuth <= EAR),
    "right": lambda top, azimuth: ~top & (azimuth <= -TEMPLE) & (azimuth >= -EAR),
    "sides": lambda top, azimuth: ~top & (azimuth.abs() >= TEMPLE) & (azimuth.abs() <= EAR),
    "back": lambda top, azimuth: ~top & (azimuth.abs() > EAR),
}
_OTHER_NAMES = {"fringe": "front"}


@dataclass(frozen=True)
class Box:
    """Strands rooted in a box: ``x0 <= x <= x1`` and so on."""

    bounds: tuple[float, float, float, float, float, float]

    def select(self, roots: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """Which strands it holds."""
        low, high = roots.new_tensor(self.bounds).view(3, 2).unbind(1)
        return ((roots >= low) & (roots <= high)).all(1)

    def __str__(self) -> str:
        return "box:" + ",".join(repr(bound) for bound in self.bounds)


@dataclass(frozen=True)
class Sphere:
    """Strands rooted within ``radius`` of a point."""

    centre: tuple[float, float, float]
    radius: float

    def select(self, roots: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """Which strands it holds."""
        return (roots - roots.new_tensor(self.centre)).norm(dim=1) <= self.radius

    def __str__(self) -> str:
        return "sphere:" + ",".join(repr(number) for number in (*self.centre, self.radius))


@dataclass(frozen=True)
class StrandIds:
    """Strands by their place among the canonical ones, counted from 0."""

    ids: tuple[int, ...]

    def select(self, roots: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """Which strands it holds.

        Raises:
            DynhairError: there are not so many strands.
        """
        if self.ids[-1] >= len(roots):
            raise DynhairError(f"there is no strand {self.ids[-1]}", expected=f"ids from 0 to {len(roots) - 1}")
        chosen = torch.zeros(len(roots), dtype=torch.bool, device=roots.device)
        chosen[torch.tensor(self.ids, device=roots.device)] = True
        return chosen

    def __str__(self) -> str:
        return "ids:" + ",".join(_runs(self.ids))


Region = NamedRegion | Box | Sphere | StrandIds
"""Some of the strands; its string is what :func:`parse_region` reads back."""


def parse_region(text: str) -> Region:
    """Read a region: a name, ``box:x0,x1,y0,y1,z0,z1``, ``sphere:x,y,z,radius``, ``ids:1,5-20`` or ``ids:FILE``.

    A file of ids holds numbers and ranges, separated by commas or white space.

    Raises:
        DynhairError: it is none of these, or the file cannot be read.
    """
    kind, colon, rest = text.strip().partition(":")
    name = _OTHER_NAMES.get(kind, kind)
    if not colon and name in _SECTIONS:
        return NamedRegion(name)
    if kind == "box":
        x0, x1, y0, y1, z0, z1 = _numbers(text, rest, 6)
        if x0 > x1 or y0 > y1 or z0 > z1:
            raise DynhairError(f"the region {text!r} is empty", expected="x0 <= x1, y0 <= y1 and z0 <= z1")
        return Box((x0, x1, y0, y1, z0, z1))
    if kind == "sphere":
        x, y, z, radius = _numbers(text, rest, 4)
        if radius <= 0:
            raise DynhairError(f"the sphere's radius is {radius:g} m", expected="more than 0")
        return Sphere((x, y, z), radius)
    if kind == "ids":
        return StrandIds(_ids(rest))
    raise DynhairError(f"there is no region {text!r}", expected=EXPECTED)


def _numbers(text: str, rest: str, count: int) -> list[float]:
    try:
        numbers = [float(number) for number in rest.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise DynhairError(f"the region {text!r} cannot be read", expected=f"{count} numbers in metres, or: {EXPECTED}")
    return numbers


def _ids(listed: str) -> tuple[int, ...]:
    """Ids from a list, or from the file of that name."""
    path = None
    if not re.fullmatch(r"[\d\s,-]*", listed):
        path = Path(listed)
        try:
            listed = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise DynhairError(f"no strand ids can be read ({error})", path=path, expected=EXPECTED) from None
    found: set[int] = set()
    for part in re.split(r"[\s,]+", listed.strip(", \t\r\n")):
        match = re.fullmatch(r"(\d{1,7})(?:-(\d{1,7}))?", part)
        if match is None or int(match[2] or match[1]) < int(match[1]):
            raise DynhairError(
                f"{part!r} is no strand id", path=path, expected="numbers and ascending ranges, such as 1,5-20"
            )
        found.update(range(int(match[1]), int(match[2] or match[1]) + 1))
    return tuple(sorted(found))


def _runs(ids: Iterable[int]) -> list[str]:
    """Ascending numbers as ranges."""
    runs: list[list[int]] = []
    for number in ids:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return [str(first) if first == last else f"{first}-{last}" for first, last in runs]
