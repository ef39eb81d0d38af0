"""How much the visible torso moves in images, whatever they show: an avatar's, or the truth's.

A torso that rests in the truth must not follow the head in the avatar's images. Both are measured alike, so that the
truth's figure tells what the measurement makes of noise, shadows and a torso that does move.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.edge_motion import EdgeMotion
from dynhair.evaluation.face import projected_hull
from dynhair.evaluation.regions import dilated

BODY_FOLLOW = 0.05
"""Vertices that follow the head less than this move with the body."""

MARGIN = 2
"""Pixels by which the torso's projection is widened, so that its outline is inside."""

FAINT_HAIR = 0.02
"""Coverage from which on hair hides a torso's pixel."""

HAIR_MARGIN = 4
"""Pixels round hair that are left out, since motion is measured over a window."""

LEAST_EDGES = 50
"""Pixels of edges that a view must show to count."""

_CONTEXT = 12
_SUBPIXEL_BITS = 4


class Torso:
    """Where a segment's views show the torso, hair aside.

    Args:
        capture: with a tracked mesh.
        segment: whose first frame everything is compared with.
        cameras: of the first frame.

    Raises:
        DynhairError: there is no such mesh, or nothing of it moves with the body.
    """

    def __init__(self, capture: Capture, segment: Segment, cameras: Sequence[Camera]) -> None:
        if capture.mesh is None:
            raise DynhairError("the capture has no mesh that tells head and body apart")
        on_body = capture.mesh.follow < BODY_FOLLOW
        faces = capture.mesh.faces[on_body[capture.mesh.faces].all(axis=1)]
        if not len(faces):
            raise DynhairError("nothing of the mesh moves with the body")
        self._capture, self._segment = capture, segment
        self._on_head = torch.from_numpy(~on_body)
        vertices = torch.from_numpy(capture.vertices(segment.start))
        torso = torch.stack([torch.from_numpy(_painted(vertices, faces, camera)) for camera in cameras])
        self._first = dilated(torso, MARGIN) & ~self._behind_head(0, cameras)

    @property
    def boxes(self) -> list[tuple[slice, slice]]:
        """Rows and columns of each view that hold all of its torso, with some context."""
        return [_box(view.numpy()) for view in self._first]

    def pixels(self, index: int, cameras: Sequence[Camera]) -> Bool[Tensor, "v h w"]:
        """Select the pixels that are the torso's in the first frame and not behind the head in this or the first.

        Args:
            index: the frame's place in the segment.
            cameras: of that frame.
        """
        return self._first & ~self._behind_head(index, cameras)

    def _behind_head(self, index: int, cameras: Sequence[Camera]) -> Bool[Tensor, "v h w"]:
        head = torch.from_numpy(self._capture.vertices(self._segment.frames[index]))[self._on_head]
        return torch.from_numpy(np.stack([projected_hull(head, camera) for camera in cameras]))


class TorsoMotion:
    """Motion of a torso's edges in one set of images, against the set's own first frame.

    Args:
        torso: where to look.
        rgb: the first frame's images.
    """

    def __init__(self, torso: Torso, rgb: Float[Tensor, "v h w 3"]) -> None:
        self._boxes = torso.boxes
        self._edges = [EdgeMotion(image[box].numpy()) for image, box in zip(rgb, self._boxes, strict=True)]

    def distances(self, rgb: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v h w"]:
        """How far each pixel of an edge has moved, pixels; ``nan`` where there is none."""
        distances = torch.full(rgb.shape[:3], torch.nan)
        for view, (edges, box) in enumerate(zip(self._edges, self._boxes, strict=True)):
            distances[view][box] = torch.from_numpy(edges.distances(rgb[view][box].numpy()))
        return distances


def without_hair(pixels: Bool[Tensor, "v h w"], coverages: Sequence[Float[Tensor, "v h w"]]) -> Bool[Tensor, "v h w"]:
    """Leave out pixels at or near hair in any of several images of the same views."""
    hair = torch.stack([coverage > FAINT_HAIR for coverage in coverages]).any(dim=0)
    return pixels & ~dilated(hair, HAIR_MARGIN)


def mean_motion(distances: Float[Tensor, "v h w"], pixels: Bool[Tensor, "v h w"]) -> Float[Tensor, " v"]:
    """Average distances over the edges among some pixels; ``nan`` for a view with fewer than `LEAST_EDGES`."""
    edges = pixels & ~distances.isnan()
    count = edges.sum(dim=(1, 2))
    mean = torch.where(edges, distances, 0.0).sum(dim=(1, 2)) / count
    return torch.where(count < LEAST_EDGES, torch.nan, mean)


def _painted(vertices: Float[Tensor, "v 3"], faces: np.ndarray, camera: Camera) -> Bool[np.ndarray, "_ _"]:
    """Select the pixels that faces touch, those behind the camera left out."""
    pixels, depths = camera.project(vertices)
    fixed = np.round((pixels.double().numpy() - 0.5) * 2**_SUBPIXEL_BITS)  # OpenCV counts from a pixel's centre
    in_view = (depths.numpy() > 0) & (np.abs(fixed) < 2**24).all(axis=1)
    canvas = np.zeros((camera.height, camera.width), np.uint8)
    for triangle in fixed[faces[in_view[faces].all(axis=1)]].astype(np.int32):
        cv2.fillConvexPoly(canvas, triangle, 1, shift=_SUBPIXEL_BITS)
    return canvas > 0


def _box(region: Bool[np.ndarray, "h w"]) -> tuple[slice, slice]:
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    if not len(rows):
        return slice(0, 2), slice(0, 2)
    return (
        slice(max(0, rows[0] - _CONTEXT), rows[-1] + 1 + _CONTEXT),
        slice(max(0, columns[0] - _CONTEXT), columns[-1] + 1 + _CONTEXT),
    )
