"""What drives the head in one frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.capture import HeadTrack
from dynhair.motion import so3_exp, so3_log


@dataclass(frozen=True)
class HeadPose:
    """Pose and expression in one frame.

    Attributes:
        rotation: of the head frame in the world.
        translation: of the head frame's origin, metres.
        rotation_vector: the rotation as axis times angle, radians.
        expression: coefficients of the face model.
    """

    rotation: Float[Tensor, "3 3"]
    translation: Float[Tensor, "3"]
    rotation_vector: Float[Tensor, "3"]
    expression: Float[Tensor, " e"]

    def corrected(self, by: Float[Tensor, "6"]) -> HeadPose:
        """The pose turned further about the head's origin by a rotation vector (radians) and moved (metres)."""
        rotation = so3_exp(by[:3]) @ self.rotation
        return replace(
            self, rotation=rotation, translation=self.translation + by[3:], rotation_vector=so3_log(rotation)
        )


def head_pose(track: HeadTrack, frame: int, device: torch.device | str = "cpu") -> HeadPose:
    """The pose and expression of one frame of a track."""
    rotation = torch.from_numpy(track.rotations[frame])
    return HeadPose(
        rotation=rotation.float().to(device),
        translation=torch.from_numpy(track.translations[frame]).float().to(device),
        rotation_vector=so3_log(rotation).float().to(device),
        expression=torch.from_numpy(track.expressions[frame]).float().to(device),
    )
