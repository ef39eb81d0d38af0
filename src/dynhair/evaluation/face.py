"""Where a frame's views show the face: the convex hull of its landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, Segment
from dynhair.evaluation.regions import convex_region


@dataclass(frozen=True)
class Square:
    """A square of an image, in pixels.

    Attributes:
        left: its first column.
        top: its first row.
        side: rows and columns.
    """

    left: int
    top: int
    side: int

    def crop(self, image: Float[Tensor, "h w 3"]) -> Float[Tensor, "_ _ 3"]:
        """The pixels inside."""
        return image[self.top : self.top + self.side, self.left : self.left + self.side]


@dataclass(frozen=True)
class FaceRegion:
    """The face in all views of a frame.

    Attributes:
        pixels: inside the landmarks' hull; none in views from behind.
        squares: the least square round them, moved into the image; None where there are no pixels.
    """

    pixels: Bool[Tensor, "v h w"]
    squares: tuple[Square | None, ...]


def face_region(capture: Capture, segment: Segment, index: int, cameras: Sequence[Camera]) -> FaceRegion:
    """Find the face in one frame.

    Args:
        capture: with landmarks.
        segment: of the capture.
        index: the frame's place in it.
        cameras: the views.

    Raises:
        DynhairError: the frame's landmarks are missing or damaged.
    """
    landmarks = torch.from_numpy(capture.landmarks_3d(segment.frames[index]))
    cosines = frontality(capture, segment, index, cameras)
    pixels = np.stack(
        [
            projected_hull(landmarks, camera) if cosine > 0 else np.zeros((camera.height, camera.width), bool)
            for camera, cosine in zip(cameras, cosines, strict=True)
        ]
    )
    return FaceRegion(torch.from_numpy(pixels), tuple(square_round(view) for view in pixels))


def frontality(
    capture: Capture, segment: Segment, index: int, cameras: Sequence[Camera]
) -> Float[np.ndarray, " views"]:
    """Cosines of the angles between where the face looks (the head frame's +z) and the cameras."""
    track = capture.track(segment)
    centres = torch.stack([camera.centre for camera in cameras]).double().numpy()
    local = (centres - track.translations[index]) @ track.rotations[index]
    return local[:, 2] / np.linalg.norm(local, axis=1)


def projected_hull(points: Float[Tensor, "n 3"], camera: Camera) -> Bool[np.ndarray, "_ _"]:
    """Select the pixels in the convex hull of projected points; none if a point is behind the camera."""
    pixels, depths = camera.project(points)
    if not (depths > 0).all():
        return np.zeros((camera.height, camera.width), bool)
    return convex_region(pixels.double().numpy(), camera.width, camera.height)


def square_round(region: Bool[np.ndarray, "h w"], margin: float = 0.0) -> Square | None:
    """Find the least square round a region, widened by a share of its side, that fits in the image; None for none."""
    if not region.any():
        return None
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    extent = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    side = min(round(extent * (1 + 2 * margin)), *region.shape)
    middle_y, middle_x = (rows[0] + rows[-1] + 1) / 2, (columns[0] + columns[-1] + 1) / 2
    top = int(np.clip(round(middle_y - side / 2), 0, region.shape[0] - side))
    left = int(np.clip(round(middle_x - side / 2), 0, region.shape[1] - side))
    return Square(left, top, side)
