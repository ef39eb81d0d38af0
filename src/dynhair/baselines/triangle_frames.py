"""A frame of its own for every triangle of a mesh, that moves, turns and grows with it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch.nn.functional import normalize

LEAST_SIZE = 1e-5
"""Metres: what is bound to a triangle that has collapsed does not vanish for good."""


class TriangleFrames(NamedTuple):
    """Frames of triangles: ``x_world = size * rotation @ x_local + origin``.

    Attributes:
        origins: the triangles' centroids, metres.
        rotations: their columns are an edge's direction, the normal, and the product of the two.
        sizes: mean of that edge's length and of the height on it, metres.
    """

    origins: Float[Tensor, "f 3"]
    rotations: Float[Tensor, "f 3 3"]
    sizes: Float[Tensor, " f"]

    def __getitem__(self, rows: Int64[Tensor, " m"]) -> TriangleFrames:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The frames of some of the triangles."""
        return TriangleFrames(*(values.index_select(0, rows) for values in tuple(self)))

    def to_world(self, local: Float[Tensor, "f 3"]) -> Float[Tensor, "f 3"]:
        """Points of the triangles' own frames in the world, metres."""
        return self.sizes[:, None] * (self.rotations @ local[..., None])[..., 0] + self.origins

    def to_local(self, world: Float[Tensor, "f 3"]) -> Float[Tensor, "f 3"]:
        """Points of the world (metres) in the triangles' own frames, one for each."""
        return (self.rotations.mT @ (world - self.origins)[..., None])[..., 0] / self.sizes[:, None]


def triangle_frames(vertices: Float[Tensor, "v 3"], faces: Int64[Tensor, "f 3"]) -> TriangleFrames:
    """The frames of a mesh's triangles (Qian et al., "GaussianAvatars", 2024, section 3.2); differentiable.

    Args:
        vertices: metres.
        faces: triangles, counter-clockwise seen from outside. One without area has no rotation: its frame's axes are
            zero, and what is bound to it lies at its centroid.
    """
    corners = vertices.index_select(0, faces.flatten()).unflatten(0, (-1, 3))
    edge, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    tiny = torch.finfo(vertices.dtype).tiny
    along = normalize(edge, dim=1, eps=tiny)
    normal = normalize(torch.linalg.cross(edge, other), dim=1, eps=tiny)
    across = torch.linalg.cross(along, normal)
    height = (other * across).sum(1).abs()
    sizes = ((torch.linalg.vector_norm(edge, dim=1) + height) / 2).clamp_min(LEAST_SIZE)
    return TriangleFrames(corners.mean(1), torch.stack([along, normal, across], -1), sizes)
