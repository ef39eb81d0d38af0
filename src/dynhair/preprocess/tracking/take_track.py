"""The track of one take."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Bool, Float
from numpy import ndarray

from dynhair.preprocess.tracking.head_motion import HeadMotion


@dataclass(frozen=True)
class TakeTrack:
    """Pose and expression over a take, and how landmarks agree with them.

    Attributes:
        name: of the take.
        motion: pose and expression in each frame.
        residuals: landmark less projection, pixels; 0 where the landmark is missing.
        belief: weight of each landmark relative to a perfect one, by score and robust cost; 0 where it is missing.
        face_sizes: side of the face in each view, pixels; 0 where no face was found.
        lost: frames whose pose is only bridged from neighbours.
        body_position: where the shoulders' frame is, metres.
        fps: frames per second.
    """

    name: str
    motion: HeadMotion
    residuals: Float[ndarray, "f v n 2"]
    belief: Float[ndarray, "f v n"]
    face_sizes: Float[ndarray, "f v"]
    lost: Bool[ndarray, " f"]
    body_position: Float[ndarray, " 3"]
    fps: float
