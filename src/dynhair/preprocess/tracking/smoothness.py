"""How heads move: with a jerk that is noise.

The third derivative of a pose is taken as white noise of constant density, so that position, velocity and acceleration
are smooth: the hair's conditions are the angular velocity and acceleration. Its best estimate given measurements before
and after an instant has no lag. Expressions may accelerate at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.spatial.transform import Rotation

from dynhair.preprocess.tracking.banded import BlockBanded
from dynhair.preprocess.tracking.head_motion import POSE, HeadMotion

REACH = 4
"""Frames that a difference spans: blocks of the band."""

_THIRD_DIFFERENCE = np.array([-1.0, 3.0, -3.0, 1.0])
_SECOND_DIFFERENCE = np.array([1.0, -2.0, 1.0])


@dataclass(frozen=True)
class Smoothness:
    """The temporal prior, in units that do not depend on the frame rate.

    Attributes:
        angular_jerk: square root of the density of the angular jerk, rad / s^2.5.
        linear_jerk: of the jerk of the head joint, m / s^2.5.
        expression_acceleration: of the acceleration of expression coefficients, 1 / s^1.5.
        fps: frames per second.
    """

    angular_jerk: float
    linear_jerk: float
    expression_acceleration: float
    fps: float

    @property
    def third_difference_deviations(self) -> tuple[float, float]:
        """Standard deviation of third differences of rotations (rad) and positions (m)."""
        return self.angular_jerk * self.fps**-2.5, self.linear_jerk * self.fps**-2.5

    @property
    def _second_difference_deviation(self) -> float:
        return self.expression_acceleration * self.fps**-1.5

    def cost(self, motion: HeadMotion) -> float:
        """Negative log-likelihood up to a constant."""
        of_pose = third_differences(motion) / np.repeat(self.third_difference_deviations, 3)
        of_expression = np.diff(motion.expressions, 2, axis=0) / self._second_difference_deviation
        return float((of_pose**2).sum() + (of_expression**2).sum()) / 2

    def linearised(self, motion: HeadMotion) -> tuple[Float[ndarray, "f u"], BlockBanded]:
        """Gradient and Gauss-Newton curvature with respect to the unknowns of ``HeadMotion.moved``."""
        frames, expressions = motion.expressions.shape
        gradient, pose = pose_smoothness(motion, *self.third_difference_deviations)
        blocks = np.zeros((frames, REACH, POSE + expressions, POSE + expressions))
        blocks[:, :, :POSE, :POSE] = pose.blocks
        precision = self._second_difference_deviation**-2
        second = np.diff(motion.expressions, 2, axis=0)
        of_expressions = np.zeros_like(motion.expressions)
        diagonal = np.arange(POSE, POSE + expressions)
        for i, left in enumerate(_SECOND_DIFFERENCE):
            of_expressions[i : i + len(second)] += precision * left * second
            for j, right in enumerate(_SECOND_DIFFERENCE[: i + 1]):
                blocks[j : j + len(second), i - j, diagonal[:, None], diagonal[:, None]] += precision * left * right
        return np.concatenate([gradient, of_expressions], 1), BlockBanded(blocks)


def third_differences(motion: HeadMotion) -> Float[ndarray, "j 6"]:
    """Third differences over four frames: of rotations, as second differences of turns, and of positions."""
    if len(motion.rotations) < REACH:
        return np.zeros((0, POSE))
    turns = turns_between(motion.rotations)
    return np.concatenate([np.diff(turns, 2, axis=0), np.diff(motion.translations, 3, axis=0)], 1)


def turns_between(rotations: Float[ndarray, "f 3 3"]) -> Float[ndarray, "g 3"]:
    """Rotation vectors from each frame to the next, in the world's frame."""
    return Rotation.from_matrix(rotations[1:] @ rotations[:-1].swapaxes(-1, -2)).as_rotvec()


def pose_smoothness(
    motion: HeadMotion, turn_deviation: float, shift_deviation: float
) -> tuple[Float[ndarray, "f 6"], BlockBanded]:
    """Gradient and Gauss-Newton curvature of half the squared third differences with respect to small poses.

    Args:
        motion: where to linearise.
        turn_deviation: standard deviation of third differences of rotations, radians.
        shift_deviation: of positions, metres.
    """
    frames = len(motion.rotations)
    gradient, blocks = np.zeros((frames, POSE)), np.zeros((frames, REACH, POSE, POSE))
    if frames < REACH:
        return gradient, BlockBanded(blocks)
    turns = turns_between(motion.rotations)
    # The turn between two frames grows by `ahead` times the later frame's small turn and falls by `behind` times the
    # earlier one's (inverse left and right Jacobians of SO(3)).
    ahead = inverse_left_jacobian(turns)
    behind = ahead.swapaxes(-1, -2)
    count = frames - REACH + 1
    slopes = np.zeros((count, REACH, POSE, POSE))
    for i, weight in enumerate(_SECOND_DIFFERENCE):
        slopes[:, i, :3, :3] -= weight * behind[i : i + count]
        slopes[:, i + 1, :3, :3] += weight * ahead[i : i + count]
    slopes[:, :, range(3, POSE), range(3, POSE)] = _THIRD_DIFFERENCE[:, None]
    precision = np.repeat([turn_deviation**-2.0, shift_deviation**-2.0], 3)
    weighted = slopes * precision[:, None]
    differences = third_differences(motion)
    for i in range(REACH):
        gradient[i : i + count] += (weighted[:, i].swapaxes(-1, -2) @ differences[..., None])[..., 0]
        for j in range(i + 1):
            blocks[j : j + count, i - j] += weighted[:, i].swapaxes(-1, -2) @ slopes[:, j]
    return gradient, BlockBanded(blocks)


def inverse_left_jacobian(vectors: Float[ndarray, "f 3"]) -> Float[ndarray, "f 3 3"]:
    """How the rotation vector of ``exp(small) @ exp(vector)`` grows with the small one."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    angle = np.linalg.norm(vectors, axis=1)
    near = angle < 1e-3
    safe = np.where(near, 1.0, angle)
    factor = np.where(near, 1 / 12, 1 / safe**2 - 1 / (2 * safe * np.tan(safe / 2)))
    return np.eye(3) - cross / 2 + factor[:, None, None] * (cross @ cross)
