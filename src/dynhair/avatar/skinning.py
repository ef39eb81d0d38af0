"""What moves with the head, what stays with the body, and the neck between."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.encoding import CANONICAL_UNIT, ENCODING_FREQUENCIES, positional_encoding
from dynhair.avatar.head_pose import HeadPose
from dynhair.avatar.rotations import multiply_quaternions, rotation_quaternion
from dynhair.motion import so3_exp, so3_log


class Placement(NamedTuple):
    """Where head and body are in a frame: rotations, translations (metres), and rotations as unit quaternions, wxyz.

    The quaternions are on the same side of their sphere, so that they can be blended.
    """

    head_rotation: Float[Tensor, "3 3"]
    head_translation: Float[Tensor, "3"]
    body_rotation: Float[Tensor, "3 3"]
    body_translation: Float[Tensor, "3"]
    head_quaternion: Float[Tensor, "4"]
    body_quaternion: Float[Tensor, "4"]

    @property
    def numbers(self) -> Float[Tensor, "32"]:
        """All of them, rotations row by row."""
        return torch.cat([part.flatten() for part in self])

    def moved(self, points: Float[Tensor, "k 3"], follow: Float[Tensor, " k"]) -> Float[Tensor, "k 3"]:
        """Points of the head frame in the world, metres; see :meth:`Skinning.world`."""
        head, body = (self.head_rotation, self.head_translation), (self.body_rotation, self.body_translation)
        return _moved(points, follow, head, body)

    def turned(self, quats: Float[Tensor, "k 4"], follow: Float[Tensor, " k"]) -> Float[Tensor, "k 4"]:
        """Rotations (wxyz) of the head frame in the world, between head and body along the shorter way."""
        # the product is linear in both, so that the two can be turned before they are blended
        with_head = multiply_quaternions(self.head_quaternion, quats)
        with_body = multiply_quaternions(self.body_quaternion, quats)
        return nn.functional.normalize(torch.lerp(with_body, with_head, follow[:, None]), dim=-1)


class Skinning(nn.Module):
    """Linear blend skinning between two frames: the head's, and the body's (beyond the paper).

    The paper moves everything rigidly with the head and leaves it to the pose networks to hold the shoulders back. Here
    a point follows the head by its own weight. Nothing tracks the body: it rests as in the rest frame, but for a linear
    answer to the head's motion, which is learned and begins as none. So a person who leans forward with head and
    shoulders is followed as well as one who only turns the head.

    Args:
        rest: the head's pose in the rest frame, in which head and body agree.
    """

    rest_rotation: Tensor
    rest_translation: Tensor

    def __init__(self, rest: HeadPose) -> None:
        super().__init__()
        self.register_buffer("rest_rotation", rest.rotation.clone())
        self.register_buffer("rest_translation", rest.translation.clone())
        self.body_response = nn.Parameter(torch.zeros(6, 6))  # from and to rotation vector and translation

    def body(self, pose: HeadPose) -> tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]]:
        """The body's rotation and translation (metres): what a point that does not follow the head moves by."""
        return self._body(*self._answer(pose))

    def world(self, points: Float[Tensor, "k 3"], follow: Float[Tensor, " k"], pose: HeadPose) -> Float[Tensor, "k 3"]:
        """Points of the head frame in the world, metres.

        Args:
            points: head frame, metres.
            follow: 1 for a point that moves with the head, 0 for one that moves with the body.
            pose: the frame's.
        """
        return _moved(points, follow, (pose.rotation, pose.translation), self.body(pose))

    def placement(self, pose: HeadPose) -> Placement:
        """Where head and body are."""
        turned, moved = self._answer(pose)
        head, body = self._quaternions(pose, turned)
        return Placement(pose.rotation, pose.translation, *self._body(turned, moved), head, body)

    def pose_code(self, pose: HeadPose) -> Float[Tensor, " p"]:
        """What the networks hear of a pose: rotation vector, and translation from rest in canonical units, encoded."""
        moved = (pose.translation - self.rest_translation) / CANONICAL_UNIT
        return positional_encoding(torch.cat([pose.rotation_vector, moved]), ENCODING_FREQUENCIES)

    def _body(
        self, turned: Float[Tensor, "3"], moved: Float[Tensor, "3"]
    ) -> tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]]:
        """The body's rotation and translation, given what it turned and moved by since the rest frame."""
        return so3_exp(turned) @ self.rest_rotation, self.rest_translation + moved

    def _quaternions(self, pose: HeadPose, turned: Float[Tensor, "3"]) -> tuple[Float[Tensor, "4"], Float[Tensor, "4"]]:
        """The rotations of head and body, wxyz, on the same side; the body has turned since the rest frame."""
        head = rotation_quaternion(pose.rotation_vector)
        rest = rotation_quaternion(so3_log(self.rest_rotation))
        body = multiply_quaternions(rotation_quaternion(turned), rest[None])[0]
        return head, torch.where((head * body).sum() < 0, -body, body)

    def _answer(self, pose: HeadPose) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
        """The body's rotation vector and displacement since the rest frame."""
        turned = so3_log(pose.rotation @ self.rest_rotation.T)
        answer = self.body_response @ torch.cat([turned, pose.translation - self.rest_translation])
        return answer[:3], answer[3:]


def _moved(
    points: Float[Tensor, "k 3"],
    follow: Float[Tensor, " k"],
    head: tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]],
    body: tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]],
) -> Float[Tensor, "k 3"]:
    """Points between where head and body carry them, each a rotation and a translation (metres)."""
    with_head, with_body = (points @ rotation.T + translation for rotation, translation in (head, body))
    return torch.lerp(with_body, with_head, follow[:, None])
