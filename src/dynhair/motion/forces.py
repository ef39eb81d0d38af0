"""What accelerates free matter in the frame of a moving head: gravity, and that this frame is not at rest."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion.signals import motion_signals


class HeadForces(NamedTuple):
    """One instant of a head's motion, in the head's frame.

    Attributes:
        omega: angular velocity, rad/s.
        alpha: angular acceleration, rad/s^2.
        pull: gravity less the acceleration of the frame's origin, m/s^2.
    """

    omega: Float[Tensor, "3"]
    alpha: Float[Tensor, "3"]
    pull: Float[Tensor, "3"]

    def on(self, points: Float[Tensor, "*n 3"], velocities: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
        """Accelerations of free points, ``pull - alpha x p - omega x (omega x p) - 2 omega x v``, m/s^2.

        Args:
            points: head frame, metres.
            velocities: as seen from the head, m/s.
        """
        omega, alpha = self.omega.expand_as(points), self.alpha.expand_as(points)
        turned = torch.linalg.cross(omega, points)
        return self.pull - torch.linalg.cross(alpha, points) - torch.linalg.cross(omega, turned + 2 * velocities)


def head_forces(track: HeadTrack) -> list[HeadForces]:
    """The forces in each frame of a segment, float32.

    The origin's acceleration is the second difference of its positions; in the first and last frame, where there is
    none, that of the neighbouring frame.

    Raises:
        DynhairError: the segment has fewer than three frames.
    """
    count = len(track.translations)
    if count < 3:
        raise DynhairError(f"a head track of {count} frames has no accelerations", expected="three frames or more")
    signals = motion_signals(track)
    return [HeadForces(*parts) for parts in zip(signals.omega, signals.alpha, signals.pull, strict=True)]
