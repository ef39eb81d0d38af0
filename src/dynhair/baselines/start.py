"""Where the baselines' Gaussians begin: on the tracked surface, as the avatar's head does, and in the hair's volume."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dynhair.avatar import ExpressionModes, Head, HeadStart, head_pose
from dynhair.avatar.branches import expression_weight
from dynhair.avatar.head import DISC, facing
from dynhair.avatar.mlp import use_precision
from dynhair.baselines.driven_mesh import DrivenMesh
from dynhair.baselines.ga import BoundGaussians
from dynhair.baselines.gha import GaussianHeadAvatar
from dynhair.baselines.hair_volume import hair_points
from dynhair.capture import Capture
from dynhair.config import Config
from dynhair.render import Gaussians
from dynhair.render.reference import quaternion_matrix
from dynhair.strands import MeshDistance
from dynhair.training.frames import rest_frame
from dynhair.training.head_start import mean_spacing, start_head
from dynhair.training.mesh_space import rest_landmarks
from dynhair.training.rest_scene import RestScene

HAIR_OPACITY = 0.3
"""That of a Gaussian of the hair's volume: many lie behind one another."""


def hair_gaussians(config: Config) -> int:
    """How many Gaussians a baseline has for hair: as many as the avatar's strands have segments."""
    return config.hair.strands * (config.hair.points - 1)


def start_gaussian_head_avatar(capture: Capture, config: Config) -> GaussianHeadAvatar:
    """The head without strands before it has seen an image; its networks say next to nothing.

    Raises:
        DynhairError: the capture has neither a tracked mesh nor landmarks of a face, or its hair masks show no hair.
    """
    start = _Start.on(capture, config)
    segment, index = rest_frame(capture)
    pose, landmarks = head_pose(capture.track(segment), index), rest_landmarks(capture)
    # sorted by the expression's share, so that each network's points lie in one piece
    share = expression_weight(start.means, landmarks, config.head.near, config.head.far)
    order = share.argsort(descending=True, stable=True)
    place = torch.empty_like(order).index_copy(0, order, torch.arange(len(order)))
    modes = start.head.modes
    of_all = HeadStart(
        means=start.means[order],
        normals=start.normals[order],
        spacing=start.spacing[order],
        colours=start.colours[order],
        opacities=start.opacities[order],
        follow=torch.cat([start.head.follow.detach(), torch.ones(start.hair)])[order],
        modes=ExpressionModes(
            place[modes.rows], modes.coefficients, modes.rest, modes.offsets.detach(), modes.turns, modes.growth
        ),
    )
    torch.manual_seed(config.training.seed)
    head = Head(of_all, landmarks, pose, start.head.config)
    use_precision(head, torch.bfloat16 if config.training.precision == "bfloat16" else None)
    background = torch.from_numpy(capture.background).float()
    return GaussianHeadAvatar(head, background, capture.expression_basis)


def start_bound_gaussians(capture: Capture, config: Config) -> BoundGaussians:
    """The Gaussians of the mesh's triangles before they have seen an image.

    Those of the skin are bound to the faces that they lie on, those around the mouth to the nearest faces, and those of
    the hair to the nearest faces of the scalp.

    Raises:
        DynhairError: the capture has neither a tracked mesh nor landmarks of a face, or its hair masks show no hair.
    """
    start, mesh = _Start.on(capture, config), DrivenMesh.tracked(capture)
    mouth = len(start.means) - len(start.face) - start.hair
    scalp = start.scene.scalp
    on_scalp = MeshDistance(start.scene.vertices, start.scene.faces[scalp])
    triangle = torch.cat(
        [
            start.scene.obstacle.nearest(start.means[:mouth]).face.long(),
            start.face,
            scalp[on_scalp.nearest(start.means[len(start.means) - start.hair :]).face.long()],
        ]
    )
    gaussians = Gaussians(
        means=start.means,
        quats=facing(start.normals),
        scales=start.spacing[:, None] * torch.tensor(DISC),
        opacities=start.opacities,
        features=start.colours,
    )
    background = torch.from_numpy(capture.background).float()
    return BoundGaussians(mesh, triangle, gaussians, background, capture.expression_basis)


@dataclass(frozen=True)
class _Start:
    """Gaussians before they have seen an image: around the mouth, on the skin, in the hair, in this order.

    Attributes:
        scene: the rest frame.
        head: has those of mouth and skin.
        means: of all, in the rest frame, head frame, metres.
        normals: that they face.
        spacing: distance of each to its neighbours, metres.
        colours: in [0, 1].
        opacities: in (0, 1).
        face: of the tracked mesh, that each of the skin lies on.
        hair: how many are hair's.
    """

    scene: RestScene
    head: Head
    means: Float[Tensor, "k 3"]
    normals: Float[Tensor, "k 3"]
    spacing: Float[Tensor, " k"]
    colours: Float[Tensor, "k 3"]
    opacities: Float[Tensor, " k"]
    face: Int64[Tensor, " s"]
    hair: int

    @classmethod
    def on(cls, capture: Capture, config: Config) -> _Start:
        seed = config.training.seed
        started = start_head(capture, dataclasses.replace(config.head, super_resolution=1), seed)
        assert started.points is not None
        scene = RestScene.of(capture, config.static.image_size)
        hair = hair_points(scene, hair_gaussians(config), seed)
        with torch.no_grad():
            head, skin = started.head, started.head.means.clone()
            outwards = hair.positions - scene.obstacle.nearest(hair.positions).position
            axes = quaternion_matrix(head.quats)[:, :, 2]
            opacities = torch.cat([head.opacity_logits.sigmoid(), torch.full((len(outwards),), HAIR_OPACITY)])
            return cls(
                scene=scene,
                head=head,
                means=torch.cat([skin, hair.positions]),
                normals=torch.cat([axes, torch.nn.functional.normalize(outwards, dim=1)]),
                spacing=torch.cat([mean_spacing(skin), mean_spacing(hair.positions)]),
                colours=torch.cat([head.base_colours[:, :3], hair.colours]),
                opacities=opacities,
                face=started.points.face,
                hair=len(outwards),
            )
