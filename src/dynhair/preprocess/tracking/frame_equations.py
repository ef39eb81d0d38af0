"""Normal equations of single frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from dynhair.preprocess.tracking.anchored_head import AnchoredHead, Person
from dynhair.preprocess.tracking.head_motion import POSE, HeadMotion, pose_columns
from dynhair.preprocess.tracking.reprojection import PointTerm


@dataclass(frozen=True)
class FrameEquations:
    """Gradient and Gauss-Newton curvature of a data term with respect to the unknowns of each frame.

    A frame's unknowns are those of ``HeadMotion.moved``: turn (3), shift (3), expression (e).

    Attributes:
        gradient: of each frame.
        curvature: of each frame.
    """

    gradient: Float[ndarray, "f u"]
    curvature: Float[ndarray, "f u u"]


def frame_columns(
    head: AnchoredHead, person: Person, motion: HeadMotion, points: Float[ndarray, "f n 3"]
) -> Float[ndarray, "f n 3 u"]:
    """How the head's points change with the unknowns of their frame, seen in the head's frame.

    Args:
        head: model of the points.
        person: its size and shape.
        motion: poses and expressions.
        points: the points in the head's frame, metres of the world.
    """
    to_head = motion.rotations.swapaxes(-1, -2)
    columns = np.empty((*points.shape, POSE + head.expression_modes.shape[-1]))
    pose = pose_columns(points)
    columns[..., :3] = pose[..., :3] @ to_head[:, None]
    columns[..., 3:POSE] = to_head[:, None]
    columns[..., POSE:] = person.scale * head.expression_modes
    return columns


def in_head_frame(term: PointTerm, motion: HeadMotion) -> PointTerm:
    """A cost's derivatives with respect to world points, turned into the head's frame."""
    gradient, curvature = term
    turn = motion.rotations[:, None]
    return gradient @ motion.rotations, turn.swapaxes(-1, -2) @ curvature @ turn


def flat(columns: Float[ndarray, "f n 3 u"]) -> Float[ndarray, "f n3 u"]:
    """All coordinates of all points in one axis."""
    return columns.reshape(len(columns), -1, columns.shape[-1])


def frame_equations(head: AnchoredHead, person: Person, motion: HeadMotion, term: PointTerm) -> FrameEquations:
    """The normal equations of a data term.

    Args:
        head: model of the points that the term is about.
        person: size and shape, taken as known.
        motion: where to linearise.
        term: derivatives of the cost with respect to world points.
    """
    gradient, curvature = in_head_frame(term, motion)
    columns = frame_columns(head, person, motion, head.points(person, motion.expressions))
    transposed = flat(columns).swapaxes(-1, -2)
    return FrameEquations(
        gradient=(transposed @ gradient.reshape(len(gradient), -1, 1))[..., 0],
        curvature=transposed @ flat(curvature @ columns),
    )
