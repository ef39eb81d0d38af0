"""What changes in time: pose and expression of the head in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.spatial.transform import Rotation

POSE = 6
"""Unknowns of a pose: a turn and a shift."""


@dataclass(frozen=True)
class HeadMotion:
    """Poses and expressions over the frames of a take: ``x_world = rotation @ x_head + translation``.

    Attributes:
        rotations: head to world.
        translations: position of the head joint, metres.
        expressions: strength of each facial action.
    """

    rotations: Float[ndarray, "f 3 3"]
    translations: Float[ndarray, "f 3"]
    expressions: Float[ndarray, "f e"]

    def to_world(self, points: Float[ndarray, "f n 3"]) -> Float[ndarray, "f n 3"]:
        """Points of the head's frame in the world."""
        return points @ self.rotations.swapaxes(-1, -2) + self.translations[:, None]

    def moved(self, steps: Float[ndarray, "f u"]) -> HeadMotion:
        """The motion after a small turn and shift of the world's frame (6) and a change of expression in each frame."""
        turns = Rotation.from_rotvec(steps[:, :3]).as_matrix()
        return HeadMotion(
            turns @ self.rotations, self.translations + steps[:, 3:POSE], self.expressions + steps[:, POSE:]
        )

    def at(self, frames: ndarray | slice) -> HeadMotion:
        """Some of the frames."""
        return HeadMotion(self.rotations[frames], self.translations[frames], self.expressions[frames])

    @classmethod
    def joined(cls, parts: Sequence[HeadMotion]) -> HeadMotion:
        """Frames of several in a row."""
        return cls(*(np.concatenate([getattr(part, field) for part in parts]) for field in cls.__dataclass_fields__))


def pose_columns(centred: Float[ndarray, "f n 3"]) -> Float[ndarray, "f n 3 6"]:
    """How world points change with a turn about the head's origin and a shift, both in the world's frame.

    Args:
        centred: world points relative to the head's origin.
    """
    x, y, z = np.moveaxis(centred, -1, 0)
    columns = np.zeros((*centred.shape, POSE))
    columns[..., 0, 1], columns[..., 0, 2] = z, -y
    columns[..., 1, 0], columns[..., 1, 2] = -z, x
    columns[..., 2, 0], columns[..., 2, 1] = y, -x
    columns[..., range(3), range(3, POSE)] = 1.0
    return columns
