"""Tracks that jitter, made smooth without delay: their derivatives drive the hair."""

from __future__ import annotations

from dataclasses import replace

from dynhair.animation.low_pass import LowPass
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError

CUTOFF = 5.0
"""Hz, for heads that a tracker found frame by frame: of a shake at 2 Hz it leaves 98 %, of angular acceleration's noise
a third."""

ORDER = 2
"""Of the Butterworth filter, run twice: gentle enough not to overshoot at a sudden stop by more than some per cent."""


def smoothed(track: HeadTrack, cutoff: float = CUTOFF) -> HeadTrack:
    """Filter a track's rotations and translations without shifting them in time; expressions stay as they are.

    Args:
        track: that jitters.
        cutoff: Hz; oscillations of this frequency are halved, slower ones kept, faster ones removed.

    Raises:
        DynhairError: the cut-off is not positive. One above what the frame rate can hold leaves the track as it is.
    """
    if not cutoff > 0:
        raise DynhairError(f"a smoothing of {cutoff} Hz", expected="a frequency above 0, such as 5")
    if cutoff >= track.fps / 2:
        return track
    low_pass = LowPass(track.fps, cutoff, ORDER)
    return replace(
        track, rotations=low_pass.rotations(track.rotations), translations=low_pass.vectors(track.translations)
    )
