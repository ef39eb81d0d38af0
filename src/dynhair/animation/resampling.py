"""Motion at any instants, brought to an avatar's frame rate.

The hair's network takes differences of neighbouring frames as velocities and accelerations: what lies between samples
must be smooth to the second derivative, and what is faster than the frame rate can hold must be gone before samples are
left out, lest it come back as slow motion.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.spatial.transform import Rotation, RotationSpline

from dynhair.animation.low_pass import LowPass
from dynhair.animation.reflection import reflected_rotations, reflected_times, reflected_vectors
from dynhair.animation.timed_motion import TimedMotion
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError

ANTI_ALIASING = 0.35
"""Of the new frame rate: the frequency that the filter halves; at half of the frame rate it leaves 5 %."""

ORDER = 4

_MARGIN = 8
"""Samples by which a motion is continued beyond its ends; a spline's end conditions have died out by then."""

_SAME_TIME = 1e-4
"""Frames by which an instant may be off the frame's own."""


def resampled(motion: TimedMotion | HeadTrack, fps: float) -> HeadTrack:
    """Take a motion's poses every 1 / fps seconds from its first instant on.

    Rotations follow SciPy's rotation spline, whose angular acceleration is continuous, translations a cubic spline, and
    expressions a monotone one, which does not overshoot. Where the motion has more samples than the track will have, it
    is first filtered without lag. A motion that has the frame rate already is left as it is.

    Args:
        motion: with two instants or more.
        fps: frames per second of the track.

    Raises:
        DynhairError: the motion has a single instant, or the frame rate is not positive.
    """
    timed = TimedMotion.of(motion) if isinstance(motion, HeadTrack) else motion
    if not fps > 0:
        raise DynhairError(f"a frame rate of {fps}", expected="a positive number of frames a second")
    if len(timed.times) < 2:
        raise DynhairError("the motion has a single instant", expected="two or more")
    elapsed = timed.times - timed.times[0]
    track = HeadTrack(
        rotations=timed.rotations,
        translations=timed.translations,
        expressions=timed.expressions,
        fps=fps,
        gravity=timed.gravity,
        expression_basis=timed.expression_basis,
    )
    if np.abs(elapsed * fps - np.arange(len(elapsed))).max() < _SAME_TIME:
        return track
    finer = max(1, math.ceil(1 / (np.median(np.diff(elapsed)) * fps) - _SAME_TIME))
    instants = np.arange(math.floor(elapsed[-1] * fps + _SAME_TIME) * finer + 1) / (fps * finer)
    rotations, translations, expressions = _interpolated(timed, elapsed, np.minimum(instants, elapsed[-1]))
    if finer > 1:
        low_pass = LowPass(fps * finer, ANTI_ALIASING * fps, ORDER)
        rotations = low_pass.rotations(rotations)
        translations, expressions = low_pass.vectors(translations), low_pass.vectors(expressions)
    return replace(
        track,
        rotations=rotations[::finer],
        translations=translations[::finer],
        expressions=expressions[::finer].astype(np.float32),
    )


def _interpolated(
    motion: TimedMotion, elapsed: Float64[np.ndarray, " f"], instants: Float64[np.ndarray, " n"]
) -> tuple[Float64[np.ndarray, "n 3 3"], Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n e"]]:
    """Rotations, translations and expressions at the given instants."""
    count = min(_MARGIN, len(elapsed) - 1)
    knots = reflected_times(elapsed, count)
    rotations = Rotation.from_matrix(reflected_rotations(motion.rotations, count))
    positions = CubicSpline(knots, reflected_vectors(motion.translations, count))
    expressions = PchipInterpolator(elapsed, motion.expressions.astype(np.float64), axis=0)
    return RotationSpline(knots, rotations)(instants).as_matrix(), positions(instants), expressions(instants)
