"""A head's motion as it comes from elsewhere: at any instants, with the pose that it calls rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64

from dynhair.capture import ExpressionBasis, HeadTrack

EARTH_GRAVITY = (0.0, -9.81, 0.0)
"""m/s^2, where nothing else is said."""


@dataclass(frozen=True)
class RestPose:
    """What a motion calls its head at rest; all motion counts from there.

    Attributes:
        rotation: head-local to world.
        translation: of the head frame's origin, metres.
        expression: the neutral expression's coefficients.
    """

    rotation: Float64[np.ndarray, "3 3"]
    translation: Float64[np.ndarray, " 3"]
    expression: Float32[np.ndarray, " e"]


@dataclass(frozen=True)
class TimedMotion:
    """A head's motion: ``x_world = rotation @ x_head + translation``.

    Attributes:
        times: seconds, increasing, not necessarily evenly.
        rotations: head-local to world.
        translations: of the head frame's origin, metres.
        expressions: expression coefficients.
        rest: the head at rest; its first frame where nothing else is known.
        gravity: in the motion's world, m/s^2.
        expression_basis: whose coefficients ``expressions`` are; None if that is not known.
    """

    times: Float64[np.ndarray, " f"]
    rotations: Float64[np.ndarray, "f 3 3"]
    translations: Float64[np.ndarray, "f 3"]
    expressions: Float32[np.ndarray, "f e"]
    rest: RestPose
    gravity: Float64[np.ndarray, " 3"]
    expression_basis: ExpressionBasis | None = None

    @classmethod
    def of(cls, track: HeadTrack, rest: RestPose | None = None) -> TimedMotion:
        """A track, which begins at 0 s, and at rest if nothing else is said."""
        first = RestPose(track.rotations[0], track.translations[0], track.expressions[0])
        return cls(
            times=np.arange(len(track.rotations)) / track.fps,
            rotations=track.rotations,
            translations=track.translations,
            expressions=track.expressions,
            rest=rest or first,
            gravity=track.gravity,
            expression_basis=track.expression_basis,
        )
