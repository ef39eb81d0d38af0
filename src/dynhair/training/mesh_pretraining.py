"""The mesh head's first shape: a head like any other where the landmarks are."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar.encoding import CANONICAL_UNIT
from dynhair.avatar.neural_surface import NeuralSurface
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.mesh import TetrahedralGrid
from dynhair.strands import MeshDistance
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.mesh_space import rest_landmarks
from dynhair.training.surface import RegisteredHead

# Adults' middling measures: centres from the mean of the landmarks, and half axes, metres.
_CENTRES = ((0.0, 0.04, -0.09), (0.0, -0.13, -0.10), (0.0, -0.37, -0.12))
_HALF_AXES = ((0.077, 0.112, 0.098), (0.058, 0.12, 0.06), (0.20, 0.17, 0.10))
_CENTRE = 1e-6  # of an ellipsoid, within which the distance to its surface is the shortest half axis
_POINTS = 4096
_RATE = 1e-3


def ellipsoids(points: Float[Tensor, "n 3"], landmarks: Float[Tensor, "m 3"]) -> Float[Tensor, " n"]:
    """Distance to a head, a neck and a trunk that are ellipsoids; negative inside, and nearly so off the surface.

    Args:
        points: head frame, metres.
        landmarks: facial landmarks, head frame, metres.
    """
    relative = points[:, None] - landmarks.mean(0) - points.new_tensor(_CENTRES)
    half = points.new_tensor(_HALF_AXES)
    # Distance over its gradient: exact to first order at the surface.
    level = (relative / half).norm(dim=-1)
    slope = (relative / half.square()).norm(dim=-1)
    reach = level.clamp_min(_CENTRE) / slope.clamp_min(_CENTRE / half.amin(-1))
    return ((level - 1) * reach).amin(1)


def first_shape(capture: Capture, grid: TetrahedralGrid) -> Float[Tensor, " n"]:
    """Signed distance, metres, of the open head registered to the rest frame's landmarks; of ellipsoids without a face.

    Gaussian Head Avatar begins with a unit sphere, but shows all of the head and no more of the trunk than the neck.
    Here hair hides most of the head, which keeps the shape that it begins with.

    Args:
        capture: gives the landmarks; its tracked mesh is not looked at.
        grid: where the distance is wanted, head frame.

    Raises:
        DynhairError: there are no landmarks.
    """
    try:
        head = RegisteredHead.to(capture)
    except DynhairError:
        return ellipsoids(grid.vertices, rest_landmarks(capture))
    segment, index = rest_frame(capture)
    vertices = head_frame(capture.track(segment), index)(head.vertices(segment.start + index))
    return MeshDistance(vertices, head.faces).query(grid.vertices)[0]


def pretrain(surface: NeuralSurface, iterations: int, seed: int) -> None:
    """Teach the geometry MLP the first shape, at random grid vertices, look where its surface is, and remember it.

    Args:
        surface: changed in place.
        iterations: Adam steps.
        seed: of the vertices drawn.

    Raises:
        DynhairError: the network has no surface, for want of steps.
    """
    optimizer = torch.optim.Adam(surface.network.parameters(), lr=_RATE)
    generator = torch.Generator().manual_seed(seed)
    for _ in range(iterations):
        rows = torch.randint(len(surface.places), (min(_POINTS, len(surface.places)),), generator=generator)
        wrong = surface.at(surface.places[rows]).sdf - surface.first[rows]
        loss = (wrong / CANONICAL_UNIT).square().mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
    with torch.no_grad():
        surface.first.copy_(surface.at(surface.places).sdf)
    surface.refresh()
