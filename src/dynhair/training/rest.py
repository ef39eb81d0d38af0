"""The head of a capture at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from dynhair.capture import Capture, HeadTrack, Segment
from dynhair.training.frames import rest_frame


@dataclass(frozen=True)
class Rest:
    """A head at rest.

    Attributes:
        segment: of the capture.
        index: the frame's place in it.
        track: of the segment.
    """

    segment: Segment
    index: int
    track: HeadTrack

    @classmethod
    def of(cls, capture: Capture) -> Rest:
        """The frame in which a capture's hair is at rest."""
        trains = any(segment.split == "train" for segment in capture.segments)
        segment, index = rest_frame(capture) if trains else (capture.segments[0], 0)
        return cls(segment, index, capture.track(segment))

    @property
    def frame(self) -> int:
        """The frame's number in the capture."""
        return self.segment.frames[self.index]

    @property
    def pose(self) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]]:
        """Rotation and translation (metres) of the head frame in the world."""
        return self.track.rotations[self.index], self.track.translations[self.index]
