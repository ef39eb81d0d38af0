"""Strands along a motion that is drawn frame by frame: each frame goes on from one before."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar.strand_deformer import StrandDeformer
from dynhair.avatar.strand_dynamics import StrandStates

PROVISIONAL = 2
"""Frames at a window's end whose conditions the next poses of a live motion may still change."""

SKIPPED = 8
"""Frames that a motion may go on by from one window to the next; after more it is unrolled anew."""

ROUNDING = 1e-5
"""By which conditions of the same frame may differ, worked out twice."""

KEPT = 4
"""States that are known at a time: those before provisional ends, which are wanted again, and those at the ends."""


class _Known(NamedTuple):
    frames: Float[Tensor, "t c"]
    states: StrandStates


class StrandMemory:
    """Guides at the ends of windows, unrolled only over what is new where a window goes on from the last one.

    A motion that is drawn in order so costs one frame of dynamics a frame, and its hair remembers more than a window.

    Args:
        deformer: whose parameters do not change.
    """

    def __init__(self, deformer: StrandDeformer) -> None:
        self._deformer = deformer
        with torch.no_grad():
            self._guides = deformer.resting()
        self._known: list[_Known] = []

    def states(self, window: Float[Tensor, "t c"]) -> StrandStates:
        """The guides at the end of a window of conditions."""
        window = self._deformer.begun(window)
        settled = max(len(window) - PROVISIONAL, 1)
        if (found := self._continued(window)) is None:
            done, states = settled, self._deformer.states(window[:settled], guides=self._guides)
            known = []
        else:
            done, states = found
            known = list(self._known)
        for end in (settled, len(window)):
            if end > done:
                done, states = end, self._deformer.states(window[done - 1 : end], states, self._guides)
            if end == done:
                known.append(_Known(window[:end], states))
        self._known = known[-KEPT:]  # at once, for threads may share an avatar
        return states

    def _continued(self, window: Float[Tensor, "t c"]) -> tuple[int, StrandStates] | None:
        """How many frames of a window are known already, and the guides in the last of these."""
        most = SKIPPED if len(window) > self._deformer.config.history else 0  # a shorter one reaches to the beginning
        for frames, states in reversed(self._known):
            for gone in range(min(most + 1, len(frames))):
                seen = frames[gone:]
                first = min(gone, 1)  # the first frame of a window that has gone on is held
                if first < len(seen) <= len(window) and torch.allclose(
                    window[first : len(seen)], seen[first:], rtol=0, atol=ROUNDING
                ):
                    return len(seen), states
        return None
