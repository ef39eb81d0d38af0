"""Another face's expressions on an avatar's face."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32

from dynhair.animation.expression_names import name_weights
from dynhair.animation.timed_motion import TimedMotion
from dynhair.capture import ExpressionBasis

LEAST_SHARED = 0.5
"""Part of the avatar's named expressions, or of the driver's, that must have a namesake; fewer make grimaces."""


def carried_expressions(
    motion: TimedMotion, neutral: Float32[np.ndarray, " e"], basis: ExpressionBasis | None
) -> tuple[Float32[np.ndarray, "f e"], str | None]:
    """A motion's expressions as an avatar makes them: what differs from the driver's neutral face is added to its own.

    Coefficients of one face model are taken over; those of another by what their names mean (see `name_weights`), where
    enough have one. Otherwise the avatar keeps its neutral expression.

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
    if basis is None or other is None or basis.matches(other):
        if found == len(neutral):
            return neutral + changes, None
        return still, f"the expression stays neutral: the driver has {found} coefficients, the avatar {len(neutral)}"
    weights = name_weights(other.names, basis.names)
    driven, driving = weights.sum(axis=1) > 0, weights.sum(axis=0) > 0
    if driven.any() and max(_part(driven, basis), _part(driving, other)) >= LEAST_SHARED:
        still[:, driven] += (changes @ weights[driven].T).astype(np.float32)
        shared = f"{driving.sum()} of the driver's {found} expressions"
        return still, f"{shared} are carried over by name, to {driven.sum()} of the avatar's {len(neutral)}"
    models = f"the driver's are of the face model '{other.name}', the avatar's of '{basis.name}'"
    return still, f"the expression stays neutral: {models}"


def _part(shared: Bool[np.ndarray, " e"], basis: ExpressionBasis) -> float:
    """Part of the expressions with a name that are shared."""
    return float(shared.sum() / max(1, sum(map(bool, basis.names))))
