"""Head poses as they come, at the rate of their source, to poses at the avatar's."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import torch

from dynhair.avatar.driving_pose import DrivingPose
from dynhair.errors import DynhairError
from dynhair.motion import so3_exp, so3_log

LONGEST_GAP = 0.5  # seconds; what happened in a longer one is anybody's guess
ROUNDING = 1e-6  # frames that an instant may lie after the last pose


class PoseStream:
    """Resamples a motion while it happens: quadratically through the three newest poses.

    A line through two would make the velocity jump at every pose of a slower source, and the hair hears acceleration.
    Nothing is filtered: a source that trembles is to be smoothed before.

    Args:
        fps: of what comes out.
    """

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._poses: deque[tuple[float, DrivingPose]] = deque(maxlen=3)
        self._frames = 0
        self._start = 0.0

    def poses(self, time: float, pose: DrivingPose) -> tuple[bool, list[DrivingPose]]:
        """Add a pose.

        Args:
            time: of the pose, seconds since any moment.
            pose: at that time.

        Returns:
            Whether a new motion begins, for want of poses for half a second; the poses of the instants at the stream's
            rate, counted from the motion's first pose, that this one brings into reach.

        Raises:
            DynhairError: time does not go on.
        """
        if not math.isfinite(time) or (self._poses and time <= self._poses[-1][0]):
            raise DynhairError(f"a head pose of the time {time} s", expected="a time after that of the pose before")
        begins = not self._poses or bool(time - self._poses[-1][0] > LONGEST_GAP)
        if begins:
            self._poses.clear()
            self._frames, self._start = 0, time
        self._poses.append((time, pose))
        return begins, list(self._reached())

    def _reached(self) -> Iterator[DrivingPose]:
        last = math.floor((self._poses[-1][0] - self._start) * self._fps + ROUNDING)
        while self._frames <= last:
            yield self._at(self._start + self._frames / self._fps)
            self._frames += 1

    def _at(self, time: float) -> DrivingPose:
        times, poses = zip(*self._poses, strict=True)
        weights = torch.tensor(
            [math.prod((time - other) / (own - other) for other in times if other != own) for own in times],
            dtype=torch.float64,
        )
        rotations, translations, expressions = (torch.stack(parts) for parts in zip(*poses, strict=True))
        middle = rotations[-2:][0]  # the rotations are added as turns from here
        return DrivingPose(
            rotation=so3_exp(weights @ so3_log(rotations @ middle.mT)) @ middle,
            translation=weights @ translations,
            expression=weights @ expressions,
        )
