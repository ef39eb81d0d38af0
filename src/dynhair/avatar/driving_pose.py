"""One head pose from outside, in whatever arrays it comes."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar.head_pose import HeadPose
from dynhair.errors import DynhairError

Array: TypeAlias = "np.ndarray | Tensor"
RigidPose: TypeAlias = "HeadPose | Array | tuple[Array, Array]"
"""A head pose, a matrix (4, 4) from the head frame to the world, or rotation (3, 3) and translation (3,) in metres."""

LEAST_PRECISE = 1e-3  # products of a rotation's columns


class DrivingPose(NamedTuple):
    """One head pose of a driving motion, in float64.

    Attributes:
        rotation: head frame to world.
        translation: of the head frame's origin, metres.
        expression: coefficients of the face model.
    """

    rotation: Float[Tensor, "3 3"]
    translation: Float[Tensor, "3"]
    expression: Float[Tensor, " e"]

    @classmethod
    def of(cls, rotation: Array, translation: Array, expression: Array) -> DrivingPose:
        """Take a pose from whatever arrays it comes in.

        Raises:
            DynhairError: the rotation is none, or a number is not finite.
        """
        parts = [torch.as_tensor(part).detach().cpu().double() for part in (rotation, translation, expression)]
        shapes = [tuple(part.shape) for part in parts]
        if shapes[:2] != [(3, 3), (3,)] or parts[2].ndim != 1:
            raise DynhairError(
                f"a head pose of the shapes {', '.join(map(str, shapes))}",
                expected="a rotation (3, 3), a translation (3,) and expression coefficients (e,)",
            )
        if not all(part.isfinite().all() for part in parts):
            raise DynhairError("a head pose has a NaN or an infinity", mend="leave out the frames without a pose")
        turn = parts[0]
        error = (turn @ turn.T - torch.eye(3, dtype=torch.float64)).abs().max()
        if error > LEAST_PRECISE or torch.linalg.det(turn) < 0:
            raise DynhairError(
                "a head pose's rotation is no rotation",
                expected="a matrix with orthonormal columns and determinant 1; a scale belongs to the face model",
            )
        return cls(*parts)


def rigid_parts(pose: RigidPose) -> tuple[Array, Array]:
    """Rotation and translation of a pose.

    Raises:
        DynhairError: it is a matrix that does not keep lengths and angles.
    """
    if isinstance(pose, HeadPose):
        return pose.rotation, pose.translation
    if isinstance(pose, tuple):
        return pose
    if tuple(pose.shape) != (4, 4) or [float(value) for value in pose[3]] != [0, 0, 0, 1]:
        raise DynhairError(
            f"a head pose of the shape {tuple(pose.shape)}", expected="a matrix (4, 4) with the last row 0 0 0 1"
        )
    return pose[:3, :3], pose[:3, 3]
