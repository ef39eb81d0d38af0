"""The mesh head's first shape: head, neck and trunk as three ellipsoids."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar.head import CANONICAL_UNIT
from dynhair.avatar.neural_surface import NeuralSurface

# Adults' middling measures: centres from the mean of the landmarks, and half axes, metres.
_CENTRES = ((0.0, 0.04, -0.09), (0.0, -0.13, -0.10), (0.0, -0.37, -0.12))
_HALF_AXES = ((0.077, 0.112, 0.098), (0.058, 0.12, 0.06), (0.20, 0.17, 0.10))
_POINTS = 4096
_RATE = 1e-3


def first_shape(points: Float[Tensor, "n 3"], landmarks: Float[Tensor, "m 3"]) -> Float[Tensor, " n"]:
    """Distance to a head with neck and trunk, negative inside; nearly so away from the surface.

    Args:
        points: head frame, metres.
        landmarks: facial landmarks, head frame, metres.
    """
    relative = points[:, None] - landmarks.mean(0) - points.new_tensor(_CENTRES)
    half = points.new_tensor(_HALF_AXES)
    # Distance over its gradient: exact to first order at the surface.
    level = (relative / half).norm(dim=-1)
    slope = (relative / half.square()).norm(dim=-1)
    return (level * (level - 1) / slope.clamp_min(1e-6)).amin(1)


def pretrain(surface: NeuralSurface, iterations: int, seed: int) -> None:
    """Teach the geometry MLP the first shape, at random grid vertices; then look where its surface is.

    Gaussian Head Avatar begins with a unit sphere, but shows no more of the trunk than the neck. A sphere would have to
    grow shoulders from their edge on, and the head's back, which hair hides, would stay a sphere's.

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
        rows = torch.randint(len(surface.places), (_POINTS,), generator=generator)
        wrong = surface.at(surface.places[rows]).sdf - surface.first[rows]
        loss = (wrong / CANONICAL_UNIT).square().mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
    surface.refresh()
