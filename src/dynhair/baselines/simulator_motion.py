"""Smooth rigid motion through the poses of a track's frames."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline


class RigidMotion:
    """A rigid frame that moves through given poses with continuous acceleration.

    A simulator takes several steps in a frame of video. Poses that are interpolated linearly would jerk the hair
    wherever the velocity jumps, at every frame of the video.

    Args:
        rotations: to the world, in each frame.
        translations: metres.
        fps: frames per second.

    Attributes:
        frames: number of poses.
        fps: frames per second.
    """

    def __init__(
        self, rotations: Float[np.ndarray, "f 3 3"], translations: Float[np.ndarray, "f 3"], fps: float
    ) -> None:
        self.frames, self.fps = len(rotations), fps
        if self.frames == 1:  # a spline needs two
            rotations, translations = np.repeat(rotations, 2, axis=0), np.repeat(translations, 2, axis=0)
        times = np.arange(len(rotations)) / fps
        self._rotation = RotationSpline(times, Rotation.from_matrix(rotations))
        self._translation = CubicSpline(times, translations, bc_type="natural")

    def __call__(self, time: float) -> tuple[Rotation, Float[np.ndarray, " 3"]]:
        """Rotation to the world and translation, metres, at a time after the first frame, seconds."""
        return self._rotation(time), self._translation(time)
