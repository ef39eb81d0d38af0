"""The avatar in the moment that the page shows, posed once for all who look at it."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar import Avatar, PosedAvatar, head_pose
from dynhair.avatar.head import HeadGaussians
from dynhair.capture import HeadTrack
from dynhair.viewer.motions import under_gravity
from dynhair.viewer.settings import Settings


@dataclass(frozen=True, eq=False)
class Shown:
    """What is on show, until something moves.

    Attributes:
        avatar: posed.
        speeds: of each canonical strand relative to the head, m/s, the mean along it; None where nobody asked.
    """

    avatar: PosedAvatar
    speeds: Float[Tensor, " n"] | None


@dataclass(frozen=True)
class _Shape:
    """Hair and head in the world, before edits."""

    strands: Float[Tensor, "n l 3"]
    head: HeadGaussians
    speeds: Float[Tensor, " n"] | None


class Poser:
    """Poses an avatar, and does nothing twice.

    Args:
        avatar: as it is without the page's edits.
    """

    def __init__(self, avatar: Avatar) -> None:
        self._own_edits, self._avatar = avatar.edits, avatar.with_edits(())
        self._edited: tuple[Hashable, Avatar] = (None, avatar)
        self._conditions: tuple[Hashable, Tensor] = (None, torch.empty(0, 0))
        self._shape: tuple[Hashable, _Shape | None] = (None, None)
        self._shown: tuple[Hashable, Shown | None] = (None, None)

    def pose(self, track: HeadTrack, frame: int, settings: Settings, motion: Hashable) -> Shown:
        """The avatar in one frame of a motion; the same object as before where nothing has changed.

        Args:
            track: the motion.
            frame: of it.
            settings: of everything else.
            motion: what tells this track from others.
        """
        of_shape = motion, frame, settings.rigid, settings.expression, settings.gravity, settings.colours
        shape = self._shape[1]
        if shape is None or self._shape[0] != of_shape:
            shape = self._shape_of(track, frame, settings, motion)
            self._shape = of_shape, shape
        of_shown = of_shape, settings.edits
        shown = self._shown[1]
        if shown is None or self._shown[0] != of_shown:
            if self._edited[0] != settings.edits:
                edits = (*self._own_edits, *settings.edits.edits())
                self._edited = settings.edits, self._avatar.with_edits(edits)
            shown = Shown(self._edited[1].with_strands(shape.strands, shape.head), shape.speeds)
            self._shown = of_shown, shown
        return shown

    def _shape_of(self, track: HeadTrack, frame: int, settings: Settings, motion: Hashable) -> _Shape:
        of_conditions = motion, settings.gravity
        if self._conditions[0] != of_conditions:
            tilted = under_gravity(track, settings.gravity)
            self._conditions = of_conditions, self._avatar.conditions(tilted)
        conditions = self._conditions[1]
        pose = head_pose(track, frame, self._avatar.background.device)
        expression = pose.expression.clone()
        for index, change in settings.expression:
            expression[index] += change
        now = None if settings.rigid else self._avatar.window(conditions, frame)
        posed, speeds = self._avatar.posed(replace(pose, expression=expression), now), None
        if settings.colours == "speed":
            before = None if now is None else self._avatar.window(conditions, max(frame - 1, 0))
            moved = self._avatar.hair(now) - self._avatar.hair(before)
            speeds = moved.norm(dim=-1).mean(1) * track.fps
        return _Shape(posed.strands, posed.head, speeds)
