"""The space that the mesh head is sought in: a box around head and shoulders, filled with tetrahedra."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.mesh import TetrahedralGrid
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.surface import tracked_surface

# Head and shoulders of any adult in the head frame, metres from the mean of the landmarks: the person's right to left,
# down to up, back to front.
_LOWEST = (-0.27, -0.42, -0.30)
_HIGHEST = (0.27, 0.24, 0.07)
_STEP = 0.01
_MARGIN = 0.02
_PERSON = 0.5


def rest_landmarks(capture: Capture) -> Float[Tensor, "66 3"]:
    """The tracked landmarks of the rest frame, head frame, metres.

    Raises:
        DynhairError: there are none.
    """
    segment, index = rest_frame(capture)
    landmarks = torch.from_numpy(capture.landmarks_3d(segment.start + index))
    return head_frame(capture.track(segment), index)(landmarks)


def person_box(capture: Capture) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
    """The least and the greatest corner of a box around what the masks leave of head and shoulders, head frame, metres.

    A place belongs to it if a camera has it in its picture in the rest frame, and no camera that does shows background
    there.

    Raises:
        DynhairError: no place does, or there are no landmarks.
    """
    centre = rest_landmarks(capture).mean(0)
    axes = [torch.arange(low, high, _STEP) for low, high in zip(_LOWEST, _HIGHEST, strict=True)]
    places = centre + torch.cartesian_prod(*axes)
    segment, index = rest_frame(capture)
    track, frame = capture.track(segment), segment.start + index
    rotation = torch.from_numpy(track.rotations[index]).float()
    world = places @ rotation.T + torch.from_numpy(track.translations[index]).float()
    pictured = torch.zeros(len(places), dtype=torch.bool)
    empty = torch.zeros(len(places), dtype=torch.bool)
    for name in capture.camera_names:
        camera, mask = capture.camera(frame, name), capture.view(frame, name).mask
        pixels, depth = camera.project(world)
        x, y = pixels.floor().long().unbind(1)
        inside = (depth > 0) & (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
        pictured |= inside
        empty[inside] |= mask[y[inside], x[inside]] < _PERSON
    kept = places[pictured & ~empty]
    if not len(kept):
        raise DynhairError(
            "the masks of the rest frame leave no room for a head around its landmarks",
            path=capture.path,
            expected="masks that show the person, and landmarks of the face in metres",
            mend="`dynhair check` draws both over the images",
        )
    return kept.amin(0) - _MARGIN, kept.amax(0) + _MARGIN


def grid_follow(capture: Capture, grid: TetrahedralGrid) -> Float[Tensor, " n"]:
    """How far each vertex of the grid follows the head: as the nearest vertex of the tracked surface does.

    Raises:
        DynhairError: the capture has neither a tracked mesh nor landmarks of a face.
    """
    from pykdtree.kdtree import KDTree

    surface = tracked_surface(capture)
    segment, index = rest_frame(capture)
    vertices = head_frame(capture.track(segment), index)(surface.vertices(segment.start + index))
    _, nearest = KDTree(vertices.numpy()).query(grid.vertices.numpy())
    return surface.follow[torch.from_numpy(np.asarray(nearest).astype(np.int64))]
