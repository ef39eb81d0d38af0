"""Where a page is looked at from, and the camera that draws the picture for it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from dynhair.camera import Camera


@dataclass(frozen=True)
class Viewpoint:
    """A browser's camera, in the world: OpenCV axes, metres.

    Attributes:
        wxyz: rotation from the camera's axes to the world's.
        position: of the camera.
        fov: vertical field of view, radians.
        canvas: width and height of what the page shows, pixels.
    """

    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    fov: float
    canvas: tuple[int, int]

    def camera(self, height: int, multiple: int = 1) -> Camera:
        """The camera whose picture, stretched over the canvas, fits what the browser draws.

        Args:
            height: of the picture, pixels.
            multiple: that both sides are rounded to; pixels are then not quite square.
        """
        aspect = self.canvas[0] / max(self.canvas[1], 1)
        wide, high = (max(round(side / multiple), 1) * multiple for side in (height * aspect, height))
        axes = Rotation.from_quat(self.wxyz, scalar_first=True).as_matrix()
        w2c = np.c_[axes.T, -axes.T @ np.array(self.position)]
        half = math.tan(self.fov / 2)
        K = np.array([[wide / 2 / (half * aspect), 0, wide / 2], [0, high / 2 / half, high / 2], [0, 0, 1]])
        return Camera(torch.from_numpy(w2c).float(), torch.from_numpy(K).float(), wide, high)


def field_of_view(camera: Camera) -> float:
    """A camera's vertical field of view, radians."""
    return 2 * math.atan(camera.height / 2 / float(camera.K[1, 1]))
