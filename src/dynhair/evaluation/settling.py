"""How long hair goes on moving after the head has suddenly stopped."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion import so3_log

ARM = 0.1
"""Metres from the head's origin at which its rotation is told as a speed: where hair lies on the head."""

LEAST_HEAD_SPEED = 0.1
"""Speed, m/s, that a head must have had to stop suddenly."""

FAST, RESTING = 0.5, 0.05
"""Of the head's greatest speed: where it is fast, and below which it rests."""

SUDDEN = 0.2
"""Seconds within which a head that was fast must rest."""

LEAST_REST = 0.4
"""Seconds that it must then rest."""

SETTLED = 0.5
"""Of the tips' greatest speed after the stop: below, hair has settled. Long hair sinks for seconds at a third of it."""

LEAST_TIP_SPEED = 0.01
"""Greatest speed of the tips after the stop, m/s, below which no hair has moved."""


class Stop(NamedTuple):
    """A head's rest after a sudden stop.

    Attributes:
        start: the first frame to which the head has not moved from the one before.
        end: the frame after the last such.
    """

    start: int
    end: int


def head_speeds(track: HeadTrack) -> Float[Tensor, " f"]:
    """Speed of the head from the frame before to each frame, ``|v| + ARM |omega|``, m/s; ``nan`` in the first."""
    if not track.fps > 0:
        raise DynhairError(f"the head track has a frame rate of {track.fps}", expected="a positive number")
    rotations, translations = torch.from_numpy(track.rotations), torch.from_numpy(track.translations)
    turned = so3_log(rotations[1:] @ rotations[:-1].mT).norm(dim=-1)
    moved = translations.diff(dim=0).norm(dim=-1)
    speeds = torch.full((len(rotations),), torch.nan, dtype=torch.float64)
    speeds[1:] = (moved + ARM * turned) * track.fps
    return speeds


def sudden_stop(track: HeadTrack) -> Stop | None:
    """Find the first time at which a fast head comes to rest within `SUDDEN` and rests for `LEAST_REST`.

    Returns:
        When it rests; None where the motion has no sudden stop.
    """
    speeds = head_speeds(track).numpy()
    greatest = np.nanmax(speeds, initial=0.0)
    if greatest < LEAST_HEAD_SPEED:
        return None
    resting = np.concatenate([[False], speeds[1:] < RESTING * greatest, [False]])
    starts, ends = np.flatnonzero(~resting[:-1] & resting[1:]) + 1, np.flatnonzero(resting[:-1] & ~resting[1:]) + 1
    for start, end in zip(starts, ends, strict=True):
        before = speeds[max(start - round(SUDDEN * track.fps), 1) : start]
        if end - start >= LEAST_REST * track.fps and (before > FAST * greatest).any():
            return Stop(int(start), int(end))
    return None


def settling_time(speeds: Float[Tensor, " f"], stop: Stop, fps: float) -> float | None:
    """Time from the stop until the tips' speed stays below `SETTLED` of its greatest value after the stop, seconds.

    Args:
        speeds: of the tips in the head's frame, from the frame before to each frame, m/s.
        stop: of the head; hair is watched until the head moves again.
        fps: frames per second.

    Returns:
        Between frames, taking the speed to change evenly; None where the hair does not move, or does not settle before
        the head moves again.
    """
    watched = speeds[stop.start : stop.end].numpy()
    if not len(watched) or not watched.max() >= LEAST_TIP_SPEED:
        return None
    bound = SETTLED * watched.max()
    last = int(np.flatnonzero(watched >= bound)[-1])
    if last == len(watched) - 1:
        return None
    return (last + float((watched[last] - bound) / (watched[last] - watched[last + 1]))) / fps
