"""Another head's motion, moved as a whole to where a head's own rest pose is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float64

from dynhair.camera import Camera
from dynhair.capture import HeadTrack


@dataclass(frozen=True)
class RestAlignment:
    """The rigid motion of the world that takes a driver's head at rest to another head at rest.

    With poses R_t, T_t of the driver, rest poses R_0, T_0 of the driver and R*, T* of the driven head, and
    B = R* R_0^T, the driven poses are ``B R_t`` and ``T* + B (T_t - T_0)``: whatever a neutral pose is in the frame of
    either head, the motion starts from the driven head's own, before its own cameras and body.

    Attributes:
        turn: B.
        origin: T_0, metres.
        target: T*, metres.
    """

    turn: Float64[np.ndarray, "3 3"]
    origin: Float64[np.ndarray, " 3"]
    target: Float64[np.ndarray, " 3"]

    @classmethod
    def between(
        cls,
        driver: tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]],
        driven: tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]],
    ) -> RestAlignment:
        """Align two heads by rotation and translation of each at rest."""
        return cls(driven[0] @ driver[0].T, driver[1], driven[1])

    def track(self, track: HeadTrack) -> HeadTrack:
        """The driver's track as the driven head follows it; expressions, gravity and frame rate stay the driver's."""
        return replace(
            track,
            rotations=self.turn @ track.rotations,
            translations=self.target + (track.translations - self.origin) @ self.turn.T,
        )

    def camera(self, camera: Camera) -> Camera:
        """The camera that sees the driven head as the driver's sees the driver."""
        rotation = camera.w2c[:, :3].double().numpy() @ self.turn.T
        translation = camera.w2c[:, 3].double().numpy() + rotation @ (self.turn @ self.origin - self.target)
        w2c = torch.from_numpy(np.column_stack([rotation, translation])).to(camera.w2c.dtype)
        return Camera(w2c, camera.K, camera.width, camera.height)
