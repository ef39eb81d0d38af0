"""Another face's expressions on an avatar's face."""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Float32

from dynhair.animation.timed_motion import TimedMotion
from dynhair.capture import ExpressionBasis

LEAST_SHARED = 0.5
"""Part of the avatar's expressions that must have a namesake; fewer make grimaces."""


def carried_expressions(
    motion: TimedMotion, neutral: Float32[np.ndarray, " e"], basis: ExpressionBasis | None
) -> tuple[Float32[np.ndarray, "f e"], str | None]:
    """A motion's expressions as an avatar makes them: what differs from the driver's neutral face is added to its own.

    Coefficients of one face model are taken over; those of another by name, where both have names that agree, as those
    of ARKit's 52 blend shapes do. Otherwise the avatar keeps its neutral expression.

    Args:
        motion: the driver's.
        neutral: the avatar's coefficients at rest.
        basis: whose coefficients these are; None if that is not known.

    Returns:
        The coefficients, and what became of the driver's in one sentence; None if they were all taken over.
    """
    still = np.tile(neutral, (len(motion.times), 1))
    found, other = motion.expressions.shape[1], motion.expression_basis
    changes = motion.expressions - motion.rest.expression
    if not np.any(changes):
        return still, None
    one_model = basis is None or other is None or basis.matches(other)
    if one_model and found == len(neutral):
        return neutral + changes, None
    shared = _namesakes(other.names, basis.names) if other is not None and basis is not None else []
    if basis is not None and len(shared) >= LEAST_SHARED * max(1, len(basis.names)):
        sources, targets = zip(*shared, strict=True)
        still[:, targets] += changes[:, sources]
        return still, f"{len(shared)} of the driver's {found} expressions are carried over by name"
    if one_model or basis is None or other is None:
        return still, f"the expression stays neutral: the driver has {found} coefficients, the avatar {len(neutral)}"
    models = f"the driver's are of the face model '{other.name}', the avatar's of '{basis.name}'"
    return still, f"the expression stays neutral: {models}"


def _namesakes(sources: tuple[str, ...], targets: tuple[str, ...]) -> list[tuple[int, int]]:
    """Places of what has the same name in both, each place at most once."""
    places = {_plain(name): place for place, name in enumerate(sources)}
    return [(places[_plain(name)], place) for place, name in enumerate(targets) if _plain(name) in places]


def _plain(name: str) -> str:
    """A name without what spellings differ in: ``eyeBlinkLeft``, ``EyeBlink_L`` and ``eye blink left`` are one."""
    letters = re.sub(r"[^a-z0-9]", "", name.lower())
    return re.sub(r"(left|right)$", lambda side: side[0][0], letters)
