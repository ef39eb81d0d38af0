"""How late an avatar's hair swings.

The signal is the mean position of the tips in the head's frame, along the axis on which the truth's varies most. For a
lag k in frames, c_k is Pearson's correlation of the avatar's signal a_(t+k) with the truth's b_t over the frames that
both have. The lag is where c_k is largest, between frames by a parabola through the largest value and its neighbours.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError

MOST_LAG = 0.3
"""Seconds that are searched on both sides: half a period of slowly swinging hair, beyond which it has no phase."""

LEAST_OVERLAP = 0.5
"""Seconds of motion that both signals must have in common at any lag."""

LEAST_SWING = 2e-3
"""Metres of standard deviation along the axis below which hair does not swing."""

LEAST_CORRELATION = 0.5
"""Of the two signals at the best lag: below, they are different motions."""


def phase_lag_ms(avatar: Float[Tensor, "f 3"], truth: Float[Tensor, "f 3"], fps: float) -> float | None:
    """Time by which an avatar's hair swings after the truth's, milliseconds; negative if before.

    Args:
        avatar: mean position of its tips in consecutive frames, in the head's frame, metres.
        truth: the same of the true hair.
        fps: frames per second.

    Returns:
        None where the truth does not swing, the avatar's motion is none or another, the best lag is not within
        `MOST_LAG`, or the motion is too short.

    Raises:
        DynhairError: the frame rate is not positive.
    """
    if not fps > 0:
        raise DynhairError(f"the frame rate is {fps}", expected="a positive number")
    most = math.floor(MOST_LAG * fps)
    if len(truth) < most + LEAST_OVERLAP * fps or most < 1:
        return None
    true_path = truth.numpy() - truth.numpy().mean(axis=0)
    axis = np.linalg.svd(true_path, full_matrices=False)[2][0]
    true_swing, swing = true_path @ axis, avatar.numpy() @ axis
    if true_swing.std() < LEAST_SWING:
        return None
    correlations = np.array([_correlation(swing, true_swing, lag) for lag in range(-most, most + 1)])
    best = int(correlations.argmax())
    if correlations[best] < LEAST_CORRELATION or best in (0, 2 * most):
        return None
    before, at, after = correlations[best - 1 : best + 2]
    between = 0.5 * (before - after) / (before - 2 * at + after)
    return float(best - most + between) / fps * 1e3


def _correlation(late: Float[np.ndarray, " f"], early: Float[np.ndarray, " f"], lag: int) -> float:
    """Pearson's correlation of ``late`` moved ahead by ``lag`` frames with ``early``; 0 where one does not vary."""
    count = len(early) - abs(lag)
    a = late[max(lag, 0) :][:count]
    b = early[max(-lag, 0) :][:count]
    a, b = a - a.mean(), b - b.mean()
    scale = math.sqrt((a @ a) * (b @ b))
    return float(a @ b) / scale if scale > 0 else 0.0
