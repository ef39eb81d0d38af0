"""From the mesh head to the Gaussian head."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dynhair.avatar import Head, HeadPose
from dynhair.avatar.mesh_head import MeshHead
from dynhair.config import HeadConfig
from dynhair.mesh import TetrahedralGrid
from dynhair.mesh_config import MeshHeadConfig
from dynhair.motion import so3_exp
from dynhair.training.mesh_pretraining import pretrain
from dynhair.training.mesh_start import start_of_mesh, take_over, vertices_when_subdivided

CONFIG = HeadConfig(gaussians=500, features=4, deformation_width=8, appearance_width=8)
RADIUS = 0.06


def pose(turn: float = 0.0, expression: float = 0.0) -> HeadPose:
    vector = torch.tensor([0.0, turn, 0.0])
    return HeadPose(so3_exp(vector), torch.tensor([0.0, 0.7, 0.0]), vector, torch.tensor([expression, 0.5]))


@pytest.fixture(scope="module")
def mesh_head() -> MeshHead:
    """A sphere whose upper half follows the head, with networks that have something to say."""
    torch.manual_seed(0)
    grid = TetrahedralGrid.of(torch.full((3,), -0.1), torch.full((3,), 0.1), 12)
    sphere = grid.vertices.norm(dim=1) - RADIUS
    landmarks = RADIUS * torch.nn.functional.normalize(torch.tensor([[0.0, 0.1, 1], [0.1, 0, 1], [-0.1, 0, 1]]), dim=1)
    follow = (grid.vertices[:, 1] > 0).float()
    head = MeshHead(grid, sphere, follow, landmarks, pose(), CONFIG, MeshHeadConfig(width=48, layers=3))
    pretrain(head.geometry, 200, 0)
    with torch.no_grad():
        for part in (head.deformation, head.colour):
            for parameter in part.parameters():
                parameter.add_(0.3 * torch.randn_like(parameter))
        head.skinning.body_response.normal_(std=0.05)
    return head


def test_gaussians_lie_evenly_on_the_neutral_mesh(mesh_head: MeshHead) -> None:
    start = start_of_mesh(mesh_head, CONFIG, 0)
    assert len(start.means) == 500
    with torch.no_grad():
        mesh = mesh_head.canonical()
    corners = mesh.vertices[mesh.faces]
    planes = torch.nn.functional.normalize(
        torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=1
    )
    offsets = ((start.means[:, None] - corners[None, :, 0]) * planes).sum(2).abs().amin(1)
    assert offsets.max() < 1e-5
    assert ((start.normals * start.means).sum(1) > 0).all()
    share = (start.means[:, 0] > 0.03).float().mean()
    assert float(share) == pytest.approx(0.25, abs=0.04)  # of a sphere's area lies beyond half its radius
    assert ((start.colours >= 0) & (start.colours <= 1)).all()
    apart = start.means[:, 1].abs() > 0.02
    torch.testing.assert_close(start.follow[apart], (start.means[apart, 1] > 0).float())
    assert 0.3 < float(start.spacing.mean()) / (4 * torch.pi * RADIUS**2 / 500) ** 0.5 < 1.2


def test_there_are_no_more_than_the_subdivided_mesh_has_vertices(mesh_head: MeshHead) -> None:
    with torch.no_grad():
        mesh = mesh_head.canonical()
    # Euler's formula for a closed surface without holes: as many edges more as a sphere's.
    wanted = len(mesh.vertices) + len(mesh.vertices) + len(mesh.faces) - 2
    assert vertices_when_subdivided(mesh) == wanted
    assert len(start_of_mesh(mesh_head, replace(CONFIG, gaussians=10**6), 0).means) == wanted


def test_the_gaussian_head_moves_and_looks_as_the_mesh_did(mesh_head: MeshHead) -> None:
    start = start_of_mesh(mesh_head, CONFIG, 0)
    head = Head(start, mesh_head.landmarks.detach(), pose(), CONFIG)
    take_over(head, mesh_head)
    driven = pose(0.4, 1.0)
    with torch.no_grad():
        shown = head(driven)
        weight = mesh_head.expression_weight(start.means)
        colours = mesh_head.colours(*mesh_head.look(start.means), weight, driven)
        moved = start.means + mesh_head.displacement(start.means, weight, driven)
        means = mesh_head.skinning.world(moved, start.follow, driven)
    torch.testing.assert_close(shown.colours, colours)
    assert (shown.means - means).norm(dim=1).max() < 1e-3  # a follow weight of 1 is drawn in to where it can learn


def test_networks_of_another_size_are_refused(mesh_head: MeshHead) -> None:
    other = replace(CONFIG, deformation_width=16)
    head = Head(start_of_mesh(mesh_head, other, 0), mesh_head.landmarks.detach(), pose(), other)
    with pytest.raises(RuntimeError, match="size mismatch"):
        take_over(head, mesh_head)
