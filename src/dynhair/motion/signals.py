"""What moves the hair: the head's angular velocity, angular acceleration, relative gravity, pull, and pose."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion.rotations import so3_log


@dataclass(frozen=True)
class MotionSignals:
    """The motion of a head over one segment.

    Attributes:
        omega: angular velocity in the head's frame, rad/s.
        alpha: angular acceleration in the head's frame, rad/s^2.
        gravity: unit direction of gravity in the head's frame.
        rotation: head-local to world, as a rotation vector (axis times angle, radians).
        translation: position of the head frame's origin in the world, metres.
        pull: gravity less the acceleration of that origin, in the head's frame, m/s^2: what a weight on a thread hangs
            along.
    """

    omega: Float[Tensor, "f 3"]
    alpha: Float[Tensor, "f 3"]
    gravity: Float[Tensor, "f 3"]
    rotation: Float[Tensor, "f 3"]
    translation: Float[Tensor, "f 3"]
    pull: Float[Tensor, "f 3"]

    def to(self, device: torch.device | str) -> MotionSignals:
        """The same signals on a device."""
        return MotionSignals(*[getattr(self, field.name).to(device) for field in fields(self)])


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
        rotation=so3_log(rotations).float(),
        translation=torch.as_tensor(track.translations, dtype=torch.float32),
        pull=(to_head @ (gravity - _accelerations(track))[..., None]).squeeze(-1).float(),
    )


def _accelerations(track: HeadTrack) -> Float[Tensor, "f 3"]:
    """Of the head frame's origin, m/s^2: second differences; at either end that of the neighbouring frame."""
    positions = torch.as_tensor(track.translations, dtype=torch.float64)
    if len(positions) < 3:
        return torch.zeros_like(positions)
    inner = positions.diff(n=2, dim=0) * track.fps**2
    return torch.cat([inner[:1], inner, inner[-1:]])


def _seconds(frames: Tensor, fps: float) -> Float[Tensor, "f 1"]:
    """Durations of frame counts; an empty interval counts as one frame, for what changed in it is zero anyway."""
    return torch.where(frames > 0, frames, 1).double()[:, None] / fps
