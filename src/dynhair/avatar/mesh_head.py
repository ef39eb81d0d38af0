"""The mesh head: a surface on a tetrahedral grid, moved and coloured by the networks that the Gaussian head takes over.

Paper, appendix A, "Canonical representation of the head", after Gaussian Head Avatar. Lengths are metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from dynhair.avatar.branches import Branches, expression_weight
from dynhair.avatar.encoding import CANONICAL_UNIT, ENCODING_FREQUENCIES, encoded_size, positional_encoding
from dynhair.avatar.head_pose import HeadPose
from dynhair.avatar.mlp import PointMLP
from dynhair.avatar.neural_surface import Extraction, NeuralSurface
from dynhair.avatar.skinning import Skinning
from dynhair.config import HeadConfig
from dynhair.mesh import TetrahedralGrid, triangle_gaussians
from dynhair.mesh_config import MeshHeadConfig
from dynhair.render import Gaussians

_APPEARANCE_LAYERS = 3
_APPEARANCE_FREQUENCIES = 6  # lips and stripes are finer than what a mesh is shaped by


@dataclass(frozen=True)
class CanonicalMesh:
    """The neutral surface, head frame, metres.

    Attributes:
        vertices: differentiable.
        faces: triangles, counter-clockwise seen from outside.
        colours: of the vertices, whatever the pose and the expression; in [0, 1].
        features: of the vertices, for the networks that add to the colours; in [-1, 1].
        follow: of the vertices, 1 for what moves with the head, 0 for what moves with the body.
        found: what the mesh was extracted from.
    """

    vertices: Float[Tensor, "v 3"]
    faces: Int64[Tensor, "f 3"]
    colours: Float[Tensor, "v 3"]
    features: Float[Tensor, "v c"]
    follow: Float[Tensor, " v"]
    found: Extraction


@dataclass(frozen=True)
class PosedMesh:
    """The surface in one frame.

    Attributes:
        displacement: of the vertices by the deformation networks, head frame, metres.
        vertices: world, metres.
        faces: triangles, counter-clockwise seen from outside.
        colours: of the vertices, not bounded.
    """

    displacement: Float[Tensor, "v 3"]
    vertices: Float[Tensor, "v 3"]
    faces: Int64[Tensor, "f 3"]
    colours: Float[Tensor, "v 3"]

    def gaussians(self) -> Gaussians:
        """The mesh as flat opaque Gaussians, to be drawn."""
        return triangle_gaussians(self.vertices, self.faces, self.colours[self.faces].mean(1))


class MeshHead(nn.Module):
    """Head and upper body as a mesh that follows expression and pose.

    Deformation, colour and skinning are those of :class:`~dynhair.avatar.head.Head` in shape and meaning. As there, a
    point has a colour of its own to which the colour networks add. That and the point's features come from a network of
    their own, where Gaussian Head Avatar lets the geometry MLP say them: colours are then learned without disturbing
    the shape, and any point can be asked.

    Args:
        grid: head frame, metres.
        first: signed distance of the shape that it begins as, at the grid's vertices, metres.
        follow: of the grid's vertices: 1 for what moves with the head, 0 for what moves with the body.
        landmarks: facial landmarks of the rest frame, head frame, metres; what becomes of them is learned.
        rest: the rest frame's pose.
        config: sizes and bounds of the Gaussian head.
        mesh_config: those of the mesh head.
    """

    _follow: Tensor

    def __init__(
        self,
        grid: TetrahedralGrid,
        first: Float[Tensor, " n"],
        follow: Float[Tensor, " n"],
        landmarks: Float[Tensor, "m 3"],
        rest: HeadPose,
        config: HeadConfig,
        mesh_config: MeshHeadConfig,
    ) -> None:
        super().__init__()
        self.config = config
        self.geometry = NeuralSurface(grid, first, mesh_config.width, mesh_config.layers)
        self.register_buffer("_follow", follow.clone(), persistent=False)
        self.landmarks = nn.Parameter(landmarks.clone())
        self.skinning = Skinning(rest)
        expression = len(rest.expression)
        position = encoded_size(3, ENCODING_FREQUENCIES)
        pose = encoded_size(6, ENCODING_FREQUENCIES)
        wide, deep, thin = config.deformation_width, config.deformation_layers, config.appearance_width
        painted = encoded_size(3, _APPEARANCE_FREQUENCIES)
        self.appearance = PointMLP(painted, 0, (mesh_config.width,) * _APPEARANCE_LAYERS, 3 + config.features)
        self.deformation = Branches(position, expression, pose, (wide,) * deep, (wide,) * 2, 3, bounded=True)
        self.colour = Branches(config.features, expression, pose, (thin,) * 2, (thin,), config.colour_channels)

    def canonical(self) -> CanonicalMesh:
        """The neutral mesh, as far as :meth:`NeuralSurface.refresh` knows where it is."""
        found = self.geometry()
        surface = found.surface
        colours, features = self.look(surface.vertices)
        follow = surface.interpolate(self._follow[found.rows, None])[:, 0].detach()
        return CanonicalMesh(surface.vertices, surface.faces, colours, features, follow, found)

    def look(self, points: Float[Tensor, "k 3"]) -> tuple[Float[Tensor, "k 3"], Float[Tensor, "k c"]]:
        """Colours in [0, 1] and features in [-1, 1] of points of the head frame; without gradient in the points.

        Args:
            points: metres.

        Returns:
            What the points look like whatever the pose and the expression; what the colour networks know them by.
        """
        code = positional_encoding(points.detach() / CANONICAL_UNIT, _APPEARANCE_FREQUENCIES)
        colours, features = self.appearance(code, code.new_empty(0)).split([3, self.config.features], dim=1)
        return colours.sigmoid(), features.tanh()

    def expression_weight(self, points: Float[Tensor, "k 3"]) -> Float[Tensor, " k"]:
        """The expression's share at points of the head frame, metres; without gradient."""
        return expression_weight(points.detach(), self.landmarks.detach(), self.config.near, self.config.far)

    def displacement(
        self, points: Float[Tensor, "k 3"], weight: Float[Tensor, " k"], pose: HeadPose
    ) -> Float[Tensor, "k 3"]:
        """How points move within the head frame, metres (appendix A, "Deformation module").

        Args:
            points: head frame, metres.
            weight: of the expression.
            pose: the frame's pose and expression.
        """
        code = positional_encoding(points / CANONICAL_UNIT, ENCODING_FREQUENCIES)
        return self.config.deformation_scale * self.deformation(
            code, weight, pose.expression, self.skinning.pose_code(pose)
        )

    def world_landmarks(self, pose: HeadPose) -> Float[Tensor, "m 3"]:
        """The landmarks in one frame, world, metres."""
        every = torch.ones_like(self.landmarks[:, 0])
        moved = self.landmarks + self.displacement(self.landmarks, every, pose)
        return self.skinning.world(moved, every, pose)

    def colours(
        self, base: Float[Tensor, "k 3"], features: Float[Tensor, "k c"], weight: Float[Tensor, " k"], pose: HeadPose
    ) -> Float[Tensor, "k 3"]:
        """Colours in one frame: those of the points themselves, and what the colour networks add."""
        return base + self.colour(features, weight, pose.expression, self.skinning.pose_code(pose))[:, :3]

    def posed(self, mesh: CanonicalMesh, pose: HeadPose) -> PosedMesh:
        """The mesh in one frame (appendix A, "Deformation module", "Appearance and attributes")."""
        weight = self.expression_weight(mesh.vertices)
        displacement = self.displacement(mesh.vertices, weight, pose)
        vertices = self.skinning.world(mesh.vertices + displacement, mesh.follow, pose)
        return PosedMesh(displacement, vertices, mesh.faces, self.colours(mesh.colours, mesh.features, weight, pose))

    def forward(self, pose: HeadPose) -> PosedMesh:
        """The neutral mesh's place and look in one frame."""
        return self.posed(self.canonical(), pose)
