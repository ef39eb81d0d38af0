"""Small heads of Gaussians, for tests."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from torch import Tensor, nn

from dynhair.avatar import ExpressionModes, Head, HeadPose, HeadStart
from dynhair.baselines.driven_mesh import DrivenMesh
from dynhair.baselines.ga import BoundGaussians
from dynhair.baselines.gha import GaussianHeadAvatar
from dynhair.camera import Camera
from dynhair.capture import ExpressionBasis, HeadTrack
from dynhair.config import HeadConfig
from dynhair.render import Gaussians

FRAMES, EXPRESSIONS = 4, 3
BASIS = ExpressionBasis("model", ("jaw", "smile", "blink"))
TETRAHEDRON = torch.tensor([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def head_track(expressions: int = EXPRESSIONS, basis: ExpressionBasis | None = None) -> HeadTrack:
    """A head that turns about the vertical and talks."""
    random = np.random.default_rng(0)
    return HeadTrack(
        rotations=Rotation.from_euler("y", np.linspace(0, 1, FRAMES)[:, None]).as_matrix(),
        translations=np.tile(np.array([0.0, 0.7, 0.0]), (FRAMES, 1)),
        expressions=random.random((FRAMES, expressions), np.float32),
        fps=10.0,
        gravity=np.array([0, -9.81, 0.0]),
        expression_basis=basis,
    )


def resting() -> HeadPose:
    """The rest frame's pose."""
    return HeadPose(torch.eye(3), torch.tensor([0.0, 0.7, 0.0]), torch.zeros(3), torch.zeros(EXPRESSIONS))


def camera(size: int = 24) -> Camera:
    """A camera a metre before the head."""
    w2c = torch.tensor([[1.0, 0, 0, 0], [0, -1.0, 0, 0.7], [0, 0, -1.0, 1.0]])
    K = torch.tensor([[2.0 * size, 0, size / 2], [0, 2.0 * size, size / 2], [0, 0, 1]])
    return Camera(w2c, K, size, size)


def driven_tetrahedron(follow: float = 1.0) -> DrivenMesh:
    """A tetrahedron of 10 cm that follows the head and is bent by the first expression coefficient."""
    vertices = 0.1 * torch.tensor([[0.0, 0, 0], [1.0, 0, 0.1], [0.2, 0, -1.0], [0.3, 1.1, -0.2]])
    modes = ExpressionModes(
        torch.tensor([3]),
        torch.tensor([0]),
        torch.zeros(EXPRESSIONS),
        torch.full((1, 1, 3), 0.02),
        torch.zeros(1, 1, 3),
        torch.zeros(1, 1),
    )
    return DrivenMesh(vertices, TETRAHEDRON, torch.full((4,), follow), modes, resting())


def bound_gaussians(count: int = 30, basis: ExpressionBasis | None = BASIS) -> BoundGaussians:
    """Gaussians of any kind around a tetrahedron, with colours that depend on the view."""
    torch.manual_seed(0)
    start = any_gaussians(count)
    head = BoundGaussians(driven_tetrahedron(), torch.randint(4, (count,)), start, torch.tensor([0.1, 0.2, 0.3]), basis)
    nn.init.normal_(head.higher_harmonics, std=0.1)
    return head


def any_gaussians(count: int) -> Gaussians:
    """Random Gaussians near the head's origin, some of them far from it."""
    return Gaussians(
        means=0.1 * torch.randn(count, 3),
        quats=nn.functional.normalize(torch.randn(count, 4), dim=1),
        scales=0.002 + 0.02 * torch.rand(count, 3),
        opacities=0.2 + 0.6 * torch.rand(count),
        features=torch.rand(count, 3),
    )


def gaussian_head_avatar(count: int = 40, basis: ExpressionBasis | None = BASIS) -> GaussianHeadAvatar:
    """Gaussians on a sphere, deformed by untrained networks."""
    torch.manual_seed(0)
    normals = nn.functional.normalize(torch.randn(count, 3), dim=1)
    start = HeadStart(
        0.1 * normals, normals, torch.full((count,), 0.02), torch.rand(count, 3), torch.full((count,), 0.7), ones(count)
    )
    landmarks = torch.tensor([[0.0, 0.0, 0.1], [0.02, 0.0, 0.1]])
    config = HeadConfig(features=4, deformation_width=8, appearance_width=8)
    head = Head(start, landmarks, resting(), config)
    return GaussianHeadAvatar(head, torch.tensor([0.1, 0.2, 0.3]), basis)


def ones(count: int) -> Float[Tensor, " k"]:
    """What follows the head."""
    return torch.ones(count)
