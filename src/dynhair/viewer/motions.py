"""What the viewer can play: the motions of a capture, and motions by name."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from dynhair.animation.procedural import MOTIONS, motion
from dynhair.avatar import Avatar, Recording
from dynhair.avatar.expression_match import require_expressions
from dynhair.capture import Capture, HeadTrack


@dataclass(frozen=True)
class Clip:
    """A motion that can be played.

    Attributes:
        label: as the page lists it.
        track: the motion.
        recorded: whether a capture has it, with the expressions of a person.
    """

    label: str
    track: HeadTrack
    recorded: bool = False

    @property
    def frames(self) -> int:
        """Its length."""
        return len(self.track.rotations)


def named_clips(recording: Recording, capture: Capture | None, avatar: Avatar) -> dict[str, Clip]:
    """All motions that an avatar can be shown in, by label: those made up, then the capture's, training first.

    Args:
        recording: of the avatar's person.
        capture: whose motions can be played too.
        avatar: that moves.

    Raises:
        DynhairError: the capture's expressions are of another face model than the avatar's.
    """
    clips = [Clip(name, motion(name, recording)) for name in MOTIONS]
    if capture is not None:
        segments = sorted(capture.segments, key=lambda segment: segment.split == "test")
        for segment in segments:
            require_expressions(capture.track(segment), avatar.head.expression_size, avatar.expression_basis)
        clips += [Clip(f"{part.name} (recorded, {part.split})", capture.track(part), True) for part in segments]
    return {clip.label: clip for clip in clips}


def under_gravity(track: HeadTrack, tilt: tuple[float, float]) -> HeadTrack:
    """The same motion in a world whose gravity is tilted.

    Args:
        track: the motion.
        tilt: degrees about the world's x axis (gravity towards +z where it pulled along -y, so that a face turned to +z
            looks down) and about its z axis (towards +x).
    """
    return replace(track, gravity=tilted(track.gravity, tilt))


def tilted(gravity: Float64[np.ndarray, " 3"], tilt: tuple[float, float]) -> Float64[np.ndarray, " 3"]:
    """Gravity tilted about the world's x and then its z axis, degrees."""
    forwards, sideways = tilt
    return Rotation.from_euler("xz", (-forwards, sideways), degrees=True).apply(gravity)
