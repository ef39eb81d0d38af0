"""Facial actions under the names that face models give them: what one face makes, as another would call it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

_MEANS = {
    "blink": ("eyeblink",),
    "browup": ("browinnerup", "browouterup"),
    "browsup": ("browinnerup", "browouterup"),
    "frown": ("mouthfrown",),
    "mouthopen": ("jawopen",),
    "smile": ("mouthsmile",),
}
"""What common names mean among ARKit's blend shapes; several are made together."""

_DIRECTIONS = frozenset({"jaw", "mouth"})
"""What moves to the left or right as a whole: there, `left` is no half of the face."""

_SIDE = re.compile(r"[\W_]*(?i:(left|right))$|(?:[\W_]+(?i:([lr]))|(?<=[a-z])([LR]))$")

Halves: TypeAlias = frozenset[tuple[str, str]]
"""Actions of one half of the face each: the action's name and ``l`` or ``r``."""


def name_weights(sources: Sequence[str], targets: Sequence[str]) -> Float64[np.ndarray, "t s"]:
    """How much of each named expression of one face goes to each of another's, by what the names mean.

    Names are equal however they are spelt: ``eyeBlinkLeft``, ``EyeBlink_L`` and ``eye blink left``. One without a side
    is of both: it takes the mean of a left and a right one, and gives itself to either. Some common names stand for
    ARKit's: ``smile``, ``frown``, ``blink``, ``mouth_open`` and ``brow_up``, which is the inner and outer brows.

    Args:
        sources: names of the face that drives; empty for those that have none.
        targets: names of the face that follows, likewise.

    Returns:
        Rows that sum to 1, or to 0 where nothing drives a target: what makes only a part of it does not.
    """
    weights = np.zeros((len(targets), len(sources)))
    known = {place: _halves(name) for place, name in enumerate(sources) if _plain(name)}
    for row, target in zip(weights, targets, strict=True):
        wanted = _halves(target) if _plain(target) else frozenset()
        givers = [_giver(half, wanted, target, known, sources) for half in sorted(wanted)]
        for giver in givers:
            if giver is not None and None not in givers:
                row[giver] += 1 / len(givers)
    return weights


def _giver(
    half: tuple[str, str], wanted: Halves, target: str, known: dict[int, Halves], sources: Sequence[str]
) -> int | None:
    """The expression that makes one half of what is wanted: of the same name, or meaning, or of little else."""

    def strangeness(place: int) -> tuple[bool, bool, int]:
        return _plain(sources[place]) != _plain(target), known[place] != wanted, len(known[place])

    return min((place for place, halves in known.items() if half in halves), key=strangeness, default=None)


def _halves(name: str) -> Halves:
    """What an expression moves, left and right."""
    side = _SIDE.search(name.strip())
    stem = _plain(name.strip()[: side.start()] if side else name)
    if side is None or stem in _DIRECTIONS:
        stem, sides = _plain(name), "lr"
    else:
        sides = next(filter(None, side.groups()))[0].lower()
    return frozenset((action, half) for action in _MEANS.get(stem, (stem,)) for half in sides)


def _plain(name: str) -> str:
    """A name without what spellings differ in."""
    return re.sub(r"[^a-z0-9]", "", name.lower())
