"""An avatar that is driven while the motion happens, one head pose at a time."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from dynhair.avatar.driving_pose import Array, DrivingPose
from dynhair.avatar.head_pose import head_pose
from dynhair.avatar.pose_stream import PoseStream
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError

if TYPE_CHECKING:
    from dynhair.avatar.avatar import Avatar
    from dynhair.avatar.drawing import PosedAvatar

STANDARD_GRAVITY = (0.0, -9.81, 0.0)  # m/s^2
SETTLED = 2  # frames after which further poses no longer change a frame's signals
REACH = 2 * SETTLED + 1  # poses that they are made of


class LiveAvatar:
    """Poses an avatar frame by frame, in constant time and memory (:meth:`Avatar.live` makes one).

    The hair hears angular velocity and acceleration, which are central differences (paper, "Motion conditioning"): a
    frame's are known two frames later. So there is a choice:

    - ``delay=2``: each step returns the frame two poses ago, exactly as :meth:`Avatar.pose` has it in the whole track;
    - ``delay=0``: it returns the newest, as if the track ended there, with one-sided differences. The next step
      corrects what is past by then. ``delay=1`` lies between.

    Args:
        avatar: what is driven; it is not changed.
        fps: frames per second of the motion; that of the avatar's recording by default, as the hair's network was
            trained at it.
        delay: frames between a pose and its avatar: 0, 1 or 2.

    Raises:
        DynhairError: no frame rate is given or known, or the delay is another.
    """

    def __init__(self, avatar: Avatar, fps: float | None = None, delay: int = SETTLED) -> None:
        recording = avatar.recording
        if fps is None and recording is None:
            raise DynhairError(
                "the avatar does not say at how many frames a second it was recorded",
                mend="name the motion's: avatar.live(fps=30.0)",
            )
        rate = recording.fps if fps is None and recording is not None else fps
        self.fps = float(rate or 0)
        if not self.fps > 0:
            raise DynhairError(f"a frame rate of {self.fps}", expected="a positive one")
        if delay not in range(SETTLED + 1):
            raise DynhairError(f"a delay of {delay} frames", expected="0, 1 or 2")
        self.delay = delay
        self._avatar = avatar
        self._gravity = np.array(STANDARD_GRAVITY) if recording is None else recording.gravity
        rest = np.zeros(avatar.head.expression_size) if recording is None else recording.rest.expression
        self._expression = torch.as_tensor(rest).double()
        self._poses: deque[DrivingPose] = deque(maxlen=REACH)
        history = avatar.hair.deformer.config.history
        self._conditions: deque[Tensor] = deque(maxlen=history + 1 + SETTLED)
        self._owed = 0  # frames that no step has returned yet, ``delay`` at most
        self._stream: PoseStream | None = None
        self._begun = False

    @torch.no_grad()
    def step(
        self,
        rotation: Array,
        translation: Array,
        expression: Array | None = None,
        gravity: Array | None = None,
        *,
        time: float | None = None,
    ) -> PosedAvatar | None:
        """Go on by one head pose.

        Args:
            rotation: head frame to world, (3, 3).
            translation: of the head frame's origin in the world, metres, (3,).
            expression: coefficients of the face model; those of the rest frame by default.
            gravity: in the world, m/s^2, from here on; at first the recording's, which is 9.81 downwards if unknown.
            time: of the pose in seconds, where poses do not come at the avatar's rate or not regularly: the motion is
                then resampled, and begins anew after half a second without a pose. Either all steps have it or none.

        Returns:
            The newest frame that is ready: None in the first ``delay`` steps and where poses come faster than frames.

        Raises:
            DynhairError: a pose is none, its expression is of another face model, or times are missing or do not go on.
        """
        given = self._expression if expression is None else expression
        pose, size = DrivingPose.of(rotation, translation, given), self._avatar.head.expression_size
        if len(pose.expression) != size:
            raise DynhairError(
                f"a head pose has {len(pose.expression)} expression coefficients",
                expected=f"{size}, as in the capture that the head was trained on",
            )
        if gravity is not None:
            self._gravity = np.asarray(gravity, np.float64)
        if self._begun and (time is None) != (self._stream is None):
            raise DynhairError(
                "some head poses have a time and some have none", expected="all or none, until `finish` ends a motion"
            )
        self._begun = True
        poses = [pose]
        if time is not None:
            self._stream = self._stream or PoseStream(self.fps)
            anew, poses = self._stream.poses(float(time), pose)
            if anew:
                self._forget()
        before = self._owed
        for reached in poses:
            self._go_on(reached)
        if not poses or before + len(poses) <= self.delay:
            return None
        return self._frame(self.delay)

    @torch.no_grad()
    def finish(self) -> list[PosedAvatar]:
        """End the motion, so that the next step begins another.

        Returns:
            The last frames, ``delay`` at most, in order.
        """
        rest = [self._frame(age) for age in reversed(range(self._owed))]
        self._forget()
        self._stream, self._begun = None, False
        return rest

    def _go_on(self, pose: DrivingPose) -> None:
        """Take in one pose at the avatar's rate."""
        for _ in range(min(SETTLED, len(self._conditions))):  # they were one-sided
            self._conditions.pop()
        self._poses.append(pose)
        self._owed = min(self._owed + 1, self.delay)
        self._conditions.extend(self._avatar.conditions(self._track())[-SETTLED - 1 :])

    def _frame(self, age: int) -> PosedAvatar:
        """The avatar as it was some frames ago."""
        track, device = self._track(), self._avatar.background.device
        pose = head_pose(track, len(self._poses) - 1 - age, device)
        window = self._avatar.window(torch.stack([*self._conditions]), len(self._conditions) - 1 - age)
        return self._avatar.posed(pose, window)

    def _track(self) -> HeadTrack:
        """The last poses; where the motion began less than five ago, they are all of it."""
        rotations, translations, expressions = (torch.stack(parts) for parts in zip(*self._poses, strict=True))
        expressions = expressions.float().numpy()
        return HeadTrack(rotations.numpy(), translations.numpy(), expressions, self.fps, self._gravity)

    def _forget(self) -> None:
        self._poses.clear()
        self._conditions.clear()
        self._owed = 0
