"""Edits of a hairstyle: what changes, by how much, and on which strands."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.editing.canonical_hair import CanonicalHair
from dynhair.editing.colours import Harmonics, brightened, tinted
from dynhair.editing.regions import WHOLE, parse_region
from dynhair.errors import DynhairError
from dynhair.strands.spreading import farthest_points


@dataclass(frozen=True)
class Edit(ABC):
    """One change of the canonical hair; it holds for every frame, for strands keep their identity.

    Attributes:
        region: the strands that change, see :func:`~dynhair.editing.regions.parse_region`.
    """

    region: str = field(default=WHOLE, kw_only=True)
    name: ClassVar[str]

    def __post_init__(self) -> None:
        object.__setattr__(self, "region", str(parse_region(self.region)))

    @abstractmethod
    def apply(self, hair: CanonicalHair) -> CanonicalHair:
        """The hair after the edit.

        Raises:
            DynhairError: the edit does not fit this hair.
        """

    @property
    @abstractmethod
    def change(self) -> str:
        """What it does, in words."""

    def __str__(self) -> str:
        where = "" if self.region == WHOLE else f" ({self.region})"
        return self.change + (where if len(where) < 60 else f"{where[:56]}...)")

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object that :func:`edit_from_json` reads back."""
        return {"edit": self.name, **{key: value for key, value in asdict(self).items() if value is not None}}


@dataclass(frozen=True)
class Brightness(Edit):
    """Scale the colours (paper, supplement, "Hairstyle color").

    Attributes:
        factor: on each channel, in (0, 4]; 0.7 is 30 % darker.
    """

    factor: float
    name: ClassVar[str] = "brightness"

    def __post_init__(self) -> None:
        super().__post_init__()
        _require("brightness", self.factor, 4.0)

    @property
    def change(self) -> str:
        """What it does, in words."""
        return f"brightness x {self.factor:g}"

    def apply(self, hair: CanonicalHair) -> CanonicalHair:
        """The hair after the edit."""
        return _recoloured(hair, self.region, lambda colours: brightened(colours, self.factor))


@dataclass(frozen=True)
class Tint(Edit):
    """Recolour the hair: the tint's hue and saturation, the hair's own lightness, see :func:`~.colours.tinted`.

    Attributes:
        colour: sRGB in [0, 1], or ``#rrggbb``, or ``R,G,B`` in [0, 1].
        strength: in [0, 1].
    """

    colour: tuple[float, float, float] | str
    strength: float = 1.0
    name: ClassVar[str] = "tint"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "colour", parse_colour(self.colour))
        _require("strength of the tint", self.strength, 1.0, zero=True)

    @property
    def change(self) -> str:
        """What it does, in words."""
        channels = ",".join(f"{channel:.3g}" for channel in parse_colour(self.colour))
        return f"tint {channels}" + (f", strength {self.strength:g}" if self.strength < 1 else "")

    def apply(self, hair: CanonicalHair) -> CanonicalHair:
        """The hair after the edit."""
        colour = hair.base_harmonic.new_tensor(parse_colour(self.colour))
        return _recoloured(hair, self.region, lambda colours: tinted(colours, colour, self.strength))


@dataclass(frozen=True)
class Trim(Edit):
    """Shorten strands at the tip. Exactly one attribute says how far.

    Attributes:
        keep: share of each strand's length that is left, in (0, 1] (paper, supplement, "Trimming").
        longest: what is longer is cut to this length, metres.
        length_of: a region; what is longer than the median of its strands is cut to that length.
    """

    keep: float | None = None
    longest: float | None = None
    length_of: str | None = None
    name: ClassVar[str] = "trim"

    def __post_init__(self) -> None:
        super().__post_init__()
        if sum(given is not None for given in (self.keep, self.longest, self.length_of)) != 1:
            raise DynhairError(
                "it is not clear how far to trim",
                expected="either the share to keep, or the greatest length in metres, or a region's length",
            )
        if self.keep is not None:
            _require("share of the length to keep", self.keep, 1.0)
        if self.longest is not None:
            _require("greatest length in metres", self.longest, 10.0)
        if self.length_of is not None:
            object.__setattr__(self, "length_of", str(parse_region(self.length_of)))

    @property
    def change(self) -> str:
        """What it does, in words."""
        if self.keep is not None:
            return f"trim to {self.keep:g} of the length"
        return f"trim to {self.longest:g} m" if self.longest is not None else f"trim to the length of {self.length_of}"

    def apply(self, hair: CanonicalHair) -> CanonicalHair:
        """The hair after the edit.

        Raises:
            DynhairError: there is no hair in the region whose length it is to have.
        """
        return replace(hair, lengths=torch.where(hair.region(self.region), self._left(hair), hair.lengths))

    def _left(self, hair: CanonicalHair) -> Float[Tensor, " n"]:
        """What would be left of each strand, metres."""
        if self.keep is not None:
            return self.keep * hair.lengths
        if self.longest is not None:
            return hair.lengths.clamp_max(self.longest)
        there = hair.lengths[hair.region(self.length_of or WHOLE) & hair.kept]
        if not len(there):
            raise DynhairError(f"all hair of the region {self.length_of} has been removed, so it has no length")
        return hair.lengths.clamp_max(float(there.median()))


@dataclass(frozen=True)
class Thin(Edit):
    """Leave a fixed, evenly spread part of the strands; a smaller part is a subset of a larger one.

    Attributes:
        keep: share of the strands that is left, in (0, 1]; at least one strand is.
    """

    keep: float
    name: ClassVar[str] = "thin"

    def __post_init__(self) -> None:
        super().__post_init__()
        _require("share of the strands to keep", self.keep, 1.0)

    @property
    def change(self) -> str:
        """What it does, in words."""
        return f"thin to {self.keep:g} of the strands"

    def apply(self, hair: CanonicalHair) -> CanonicalHair:
        """The hair after the edit."""
        region = hair.region(self.region)
        there = (hair.kept & region).nonzero()[:, 0]
        count = max(round(self.keep * len(there)), 1)
        kept = hair.kept & ~region
        kept[there[farthest_points(hair.strands[there, 0], count)]] = True
        return replace(hair, kept=kept)


@dataclass(frozen=True)
class Width(Edit):
    """Make strands thicker or finer.

    Attributes:
        factor: on the width, in (0, 10].
    """

    factor: float
    name: ClassVar[str] = "width"

    def __post_init__(self) -> None:
        super().__post_init__()
        _require("factor on the width", self.factor, 10.0)

    @property
    def change(self) -> str:
        """What it does, in words."""
        return f"width x {self.factor:g}"

    def apply(self, hair: CanonicalHair) -> CanonicalHair:
        """The hair after the edit."""
        return replace(hair, widths=torch.where(hair.region(self.region), self.factor * hair.widths, hair.widths))


KINDS: dict[str, type[Edit]] = {kind.name: kind for kind in (Brightness, Tint, Trim, Thin, Width)}


def edit_from_json(value: Any) -> Edit:
    """Read what :meth:`Edit.to_json` returned.

    Raises:
        DynhairError: it is no edit.
    """
    kind = KINDS.get(str(value.get("edit"))) if isinstance(value, Mapping) else None
    if kind is None:
        raise DynhairError(f"{value!r} is no edit", expected=f'an object whose "edit" is one of: {", ".join(KINDS)}')
    fields = {str(key): _plain(item) for key, item in value.items() if key != "edit"}
    try:
        return kind(**fields)
    except (TypeError, AttributeError) as error:
        raise DynhairError(f"{value!r} is no edit ({error})", expected=f"what {value['edit']} takes") from None


def edits_from_json(values: Any) -> tuple[Edit, ...]:
    """Read a list of edits, first to last.

    Raises:
        DynhairError: it is no list, or holds what is no edit.
    """
    if not isinstance(values, Sequence) or isinstance(values, str):
        raise DynhairError(f"the edits are {values!r}", expected="a list of edits")
    return tuple(map(edit_from_json, values))


def parse_colour(given: str | tuple[float, float, float]) -> tuple[float, float, float]:
    """Read ``#rrggbb``, or ``R,G,B`` in [0, 1], as sRGB in [0, 1].

    Raises:
        DynhairError: it is neither.
    """
    expected = "#rrggbb, or three numbers from 0 to 1, such as 0.8,0.3,0.1"
    if isinstance(given, str) and given.startswith("#"):
        digits = given[1:]
        if len(digits) != 6 or not set(digits) <= set("0123456789abcdefABCDEF"):
            raise DynhairError(f"{given!r} is no colour", expected=expected)
        red, green, blue = (int(digits[at : at + 2], 16) / 255 for at in (0, 2, 4))
        return red, green, blue
    try:
        red, green, blue = (float(channel) for channel in (given.split(",") if isinstance(given, str) else given))
    except (TypeError, ValueError):
        raise DynhairError(f"{given!r} is no colour", expected=expected) from None
    if not all(0 <= channel <= 1 for channel in (red, green, blue)):
        raise DynhairError(f"{given!r} is no colour", expected=expected)
    return red, green, blue


def _recoloured(hair: CanonicalHair, region: str, change: Callable[[Harmonics], Harmonics]) -> CanonicalHair:
    """The hair with other colours in a region."""
    colours = Harmonics(hair.base_harmonic, hair.higher_harmonics)
    segments = hair.segments_of(hair.region(region))
    base, higher = (torch.where(segments, new, old) for new, old in zip(change(colours), colours, strict=True))
    return replace(hair, base_harmonic=base, higher_harmonics=higher)


def _require(what: str, value: Any, most: float, *, zero: bool = False) -> None:
    """Refuse what is no positive number up to ``most``, nor 0 if that is allowed."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not (0 < value <= most or (zero and value == 0)):
        raise DynhairError(
            f"the {what} is {value!r}", expected=f"{'from 0' if zero else 'more than 0'} to at most {most:g}"
        )


def _plain(value: Any) -> Any:
    """A JSON value as the edits take it: numbers as floats, lists as tuples of them."""
    if isinstance(value, list):
        return tuple(map(_plain, value))
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value
