"""What the head's motion does to the hair: angular velocity, angular acceleration and relative gravity."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion.rotations import so3_log


@dataclass(frozen=True)
class MotionSignals:
    """The motion of a head over one segment, in the head's own frame.

    Attributes:
        omega: angular velocity, rad/s.
        alpha: angular acceleration, rad/s^2.
        gravity: unit direction of gravity.
    """

    omega: Float[Tensor, "f 3"]
    alpha: Float[Tensor, "f 3"]
    gravity: Float[Tensor, "f 3"]


def motion_signals(track: HeadTrack) -> MotionSignals:
    """Motion signals of one segment (paper, "Motion conditioning").

    Angular velocity and acceleration are the paper's central differences, then turned into the head's frame. At the
    first and last frame of the segment they become one-sided: a difference is always divided by the time between the
    instants it belongs to, so that a rotation of constant acceleration has its true acceleration in every frame. A
    segment of one frame is at rest; one of two frames has a velocity and no acceleration.

    Args:
        track: the head's pose over the segment, at any frame rate.

    Returns:
        float32 signals, computed in float64.

    Raises:
        DynhairError: the track has no frames, its frame rate is not positive, or its gravity has no direction.
    """
    rotations = torch.as_tensor(track.rotations, dtype=torch.float64)
    gravity = torch.as_tensor(track.gravity, dtype=torch.float64)
    count = len(rotations)
    if count == 0:
        raise DynhairError("the head track has no frames", expected="at least one frame")
    if not track.fps > 0:
        raise DynhairError(f"the head track has a frame rate of {track.fps}", expected="a positive frame rate")
    if not gravity.norm() > 0:
        raise DynhairError(f"gravity is {gravity.tolist()}: it has no direction", expected="a vector such as 0 -9.81 0")

    frames = torch.arange(count)
    before, after = (frames - 1).clamp_min(0), (frames + 1).clamp_max(count - 1)
    omega = so3_log(rotations[after] @ rotations[before].mT) / _seconds(after - before, track.fps)
    # A one-sided velocity belongs to the middle of its interval, half a frame from the segment's end.
    instants = (after + before) / 2
    alpha = (omega[after] - omega[before]) / _seconds(instants[after] - instants[before], track.fps)

    to_head = rotations.mT
    direction = torch.nn.functional.normalize(to_head @ gravity, dim=-1)
    return MotionSignals(
        omega=(to_head @ omega[..., None]).squeeze(-1).float(),
        alpha=(to_head @ alpha[..., None]).squeeze(-1).float(),
        gravity=direction.float(),
    )


def _seconds(frames: Tensor, fps: float) -> Float[Tensor, "f 1"]:
    """Durations of frame counts; an empty interval counts as one frame, for what changed in it is zero anyway."""
    return torch.where(frames > 0, frames, 1).double()[:, None] / fps
