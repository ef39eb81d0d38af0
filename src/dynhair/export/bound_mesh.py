"""The head as a mesh: the tracker's surface, carried along by the avatar's Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dynhair.avatar import Avatar, Head, HeadMesh, HeadPose
from dynhair.export.colours import mean_colours
from dynhair.motion import so3_log

NEIGHBOURS = 8
LEAST_DISTANCE = 1e-3
"""Metres. Gaussians nearer than this to a vertex have equal shares in it."""


@dataclass(frozen=True)
class BoundMesh:
    """A mesh that moves as the head's Gaussians around each of its vertices do.

    A vertex follows head and body by the mean weight of its nearest Gaussians, and is displaced by what they are
    displaced by beyond that: so it takes up expressions and whatever the networks have learned, in any motion.

    Attributes:
        head: the avatar's.
        rest: the mesh.
        anchors: the head's Gaussians at rest, head frame, metres.
        near: those that carry each vertex.
        shares: of these in it; they sum to 1.
        colours: of the vertices at rest, sRGB in [0, 1].
    """

    head: Head
    rest: HeadMesh
    anchors: Float[Tensor, "k 3"]
    near: Int64[Tensor, "v q"]
    shares: Float[Tensor, "v q"]
    colours: Float[Tensor, "v 3"]

    @classmethod
    def to(cls, avatar: Avatar, mesh: HeadMesh) -> BoundMesh:
        """Bind a mesh to the Gaussians of an avatar's head that are nearest to it at rest."""
        from pykdtree.kdtree import KDTree

        head, skinning = avatar.head, avatar.head.skinning
        rotation, translation = skinning.rest_rotation, skinning.rest_translation
        with torch.no_grad():
            posed = avatar.posed(HeadPose(rotation, translation, so3_log(rotation), head.modes.rest), None)
            rows, cover, hair = avatar.scalp(mean_colours(posed.hair.base_harmonic)[None], posed.hair)
        gaussians = posed.head.colours[:, :3]
        gaussians = gaussians.index_copy(0, rows, torch.lerp(gaussians[rows], hair[0], cover[:, None]))
        anchors = (posed.head.means - translation) @ rotation
        points = [np.ascontiguousarray(every.cpu().numpy(), np.float32) for every in (anchors, mesh.vertices)]
        distances, near = KDTree(points[0]).query(points[1], k=min(NEIGHBOURS, len(anchors)))
        indices = torch.from_numpy(near.astype(np.int64)).reshape(len(mesh.vertices), -1).to(anchors.device)
        weights = 1 / torch.from_numpy(distances).reshape(len(mesh.vertices), -1).clamp_min(LEAST_DISTANCE).square()
        shares = (weights / weights.sum(1, keepdim=True)).to(anchors)
        seen = shares * posed.head.opacities[indices]
        colours = (gaussians[indices] * seen[..., None]).sum(1) / seen.sum(1, keepdim=True).clamp_min(1e-9)
        rest = HeadMesh(mesh.vertices.to(anchors), mesh.faces)
        return cls(head, rest, anchors, indices, shares, colours.clamp(0, 1))

    def vertices(self, pose: HeadPose, means: Float[Tensor, "k 3"]) -> Float[Tensor, "v 3"]:
        """The mesh in one frame, world, metres.

        Args:
            pose: the frame's.
            means: the head's Gaussians in that frame, world, metres.
        """
        skinning, follow = self.head.skinning, self.head.follow
        displaced = means - skinning.world(self.anchors, follow, pose)
        carried = skinning.world(self.rest.vertices, (follow[self.near] * self.shares).sum(1), pose)
        return carried + (displaced[self.near] * self.shares[..., None]).sum(1)
