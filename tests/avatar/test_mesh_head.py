"""The mesh head: its surface, its band of evaluation, its motion and its colours."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from dynhair.avatar.head_pose import HeadPose
from dynhair.avatar.mesh_head import MeshHead
from dynhair.avatar.neural_surface import NeuralSurface
from dynhair.config import HeadConfig
from dynhair.errors import DynhairError
from dynhair.mesh import TetrahedralGrid
from dynhair.mesh_config import MeshHeadConfig
from dynhair.motion import so3_exp

RADIUS = 0.06
CONFIG = HeadConfig(features=4, deformation_width=8, appearance_width=8)
MESH_CONFIG = MeshHeadConfig(width=16, layers=3)


def pose(turn: tuple[float, float, float] = (0.0, 0.0, 0.0), shift: float = 0.0, expression: float = 0.0) -> HeadPose:
    vector = torch.tensor(turn)
    return HeadPose(so3_exp(vector), torch.tensor([shift, 0.7, 0.0]), vector, torch.tensor([expression, 0.5]))


def cube(resolution: int = 12, half: float = 0.1) -> TetrahedralGrid:
    return TetrahedralGrid.of(torch.full((3,), -half), torch.full((3,), half), resolution)


def face(radius: float = RADIUS) -> Tensor:
    """Landmarks on the front of a sphere."""
    across = torch.tensor([[x, y, 1.5] for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)])
    return radius * torch.nn.functional.normalize(across, dim=1)


def sphere(grid: TetrahedralGrid) -> Tensor:
    return grid.vertices.norm(dim=1) - RADIUS


def learn_sphere(surface: NeuralSurface, steps: int = 250) -> None:
    optimizer = torch.optim.Adam(surface.network.parameters(), lr=5e-3)
    for _ in range(steps):
        loss = (surface.at(surface.places).sdf - surface.first).div(0.1).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    surface.refresh()


@pytest.fixture(scope="module")
def trained() -> dict[str, Tensor]:
    torch.manual_seed(0)
    head = MeshHead(cube(), sphere(cube()), torch.ones(len(cube().vertices)), face(), pose(), CONFIG, MESH_CONFIG)
    learn_sphere(head.geometry)
    return head.state_dict()


def sphere_head(trained: dict[str, Tensor], follow: Tensor | None = None) -> MeshHead:
    grid = cube()
    follow = torch.ones(len(grid.vertices)) if follow is None else follow
    head = MeshHead(grid, sphere(grid), follow, face(), pose(), CONFIG, MESH_CONFIG)
    head.load_state_dict(trained)
    return head


def loosen(head: MeshHead) -> None:
    """Give the networks of deformation and colour something to say."""
    generator = torch.Generator().manual_seed(1)
    for branches in (head.deformation, head.colour):
        for parameter in branches.parameters():
            parameter.data.add_(0.3 * torch.randn(parameter.shape, generator=generator))


def test_the_surface_is_where_the_network_says(trained: dict[str, Tensor]) -> None:
    head = sphere_head(trained)
    mesh = head.canonical()
    assert (mesh.vertices.norm(dim=1) - RADIUS).abs().max() < 0.006
    corners = mesh.vertices[mesh.faces]
    volume = (corners[:, 0] * torch.linalg.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert float(volume.detach()) == pytest.approx(
        4 / 3 * torch.pi * RADIUS**3, rel=0.1
    )  # positive: faces look outwards
    assert ((mesh.colours >= 0) & (mesh.colours <= 1)).all()
    assert mesh.features.abs().max() <= 1


def test_only_the_surroundings_are_evaluated_and_give_the_same_surface(trained: dict[str, Tensor]) -> None:
    head = sphere_head(trained)
    assert (head.geometry.near > 0).float().mean() < 0.7
    band = head.canonical()
    everywhere = head.state_dict() | {"geometry.near": torch.full_like(head.geometry.near, 2)}
    head.load_state_dict(everywhere)
    whole = head.canonical()
    assert len(whole.faces) == len(band.faces)
    torch.testing.assert_close(band.vertices, whole.vertices, atol=1e-6, rtol=0)
    torch.testing.assert_close(band.features, whole.features, atol=1e-4, rtol=0)


@pytest.mark.parametrize("millimetres", [3, 10, 20])
def test_the_surface_is_followed_where_it_goes(trained: dict[str, Tensor], millimetres: int) -> None:
    head = sphere_head(trained)
    last = head.geometry.network.layers[-1]
    assert isinstance(last, torch.nn.Linear)
    found = head.canonical().vertices
    for _ in range(3):
        with torch.no_grad():
            last.bias[0] += millimetres / 300
        found = head.canonical().vertices
    assert (found.norm(dim=1) - RADIUS + millimetres / 1000).abs().max() < 0.008
    head.geometry.refresh()
    torch.testing.assert_close(head.canonical().vertices, found, atol=1e-6, rtol=0)


def test_no_surface_is_refused(trained: dict[str, Tensor]) -> None:
    head = sphere_head(trained)
    last = head.geometry.network.layers[-1]
    assert isinstance(last, torch.nn.Linear)
    with torch.no_grad():
        last.bias[0] += 5
    with pytest.raises(DynhairError, match="no surface"):
        head.geometry.refresh()


def test_what_follows_the_head_moves_rigidly_and_the_rest_stays(trained: dict[str, Tensor]) -> None:
    grid = cube()
    head = sphere_head(trained, (grid.vertices[:, 1] > 0).float())
    with torch.no_grad():
        for parameter in head.deformation.parameters():
            parameter.zero_()
    turned = pose((0.1, 0.4, 0.0), 0.02)
    mesh, canonical = head(turned), head.canonical()
    above, below = canonical.vertices[:, 1] > 0.02, canonical.vertices[:, 1] < -0.02
    torch.testing.assert_close(canonical.follow[above], torch.ones(int(above.sum())))
    moved = canonical.vertices[above] @ turned.rotation.T + turned.translation
    torch.testing.assert_close(mesh.vertices[above], moved)
    torch.testing.assert_close(mesh.vertices[below], canonical.vertices[below] + pose().translation)


def test_near_the_landmarks_the_expression_rules_and_far_off_the_pose(trained: dict[str, Tensor]) -> None:
    head = sphere_head(trained)
    loosen(head)
    still, smiling, nodding = head(pose()), head(pose(expression=1.0)), head(pose((0.3, 0.0, 0.0)))
    distance = torch.cdist(head.canonical().vertices, head.landmarks).amin(1)
    near, far = distance < CONFIG.near, distance > CONFIG.far
    for now in ("displacement", "colours"):
        at_rest, by_expression, by_pose = (getattr(mesh, now) for mesh in (still, smiling, nodding))
        assert near.any()
        assert far.any()
        assert (by_expression - at_rest)[near].norm() > 1e-3
        torch.testing.assert_close(by_expression[far], at_rest[far])
        torch.testing.assert_close(by_pose[near], at_rest[near])
        assert (by_pose - at_rest)[far].norm() > 1e-3
    assert smiling.displacement.norm(dim=1).max() <= CONFIG.deformation_scale * 3**0.5


def test_landmarks_move_as_the_surface_there_does(trained: dict[str, Tensor]) -> None:
    head = sphere_head(trained)
    loosen(head)
    driven = pose((0.1, 0.2, 0.3), 0.01, 1.0)
    every = torch.ones(len(head.landmarks))
    displacement = head.displacement(head.landmarks, every, driven)
    wanted = (head.landmarks + displacement) @ driven.rotation.T + driven.translation
    torch.testing.assert_close(head.world_landmarks(driven), wanted)


def test_every_parameter_has_a_gradient(trained: dict[str, Tensor]) -> None:
    head = sphere_head(trained, torch.full((len(cube().vertices),), 0.5))
    loosen(head)
    driven = pose((0.1, 0.2, 0.3), 0.01, 1.0)
    gaussians = head(driven).gaussians()
    weights = torch.randn(len(gaussians.means), 9, generator=torch.Generator().manual_seed(0))
    drawn = torch.cat([gaussians.means, gaussians.scales, gaussians.features], 1)
    ((drawn * weights).sum() + head.world_landmarks(driven).square().sum()).backward()
    for name, parameter in head.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().max() > 0, name


def test_the_mesh_becomes_one_opaque_gaussian_a_triangle(trained: dict[str, Tensor]) -> None:
    mesh = sphere_head(trained)(pose())
    gaussians = mesh.gaussians()
    assert len(gaussians.means) == len(mesh.faces)
    torch.testing.assert_close(gaussians.means, mesh.vertices[mesh.faces].mean(1))
    assert gaussians.features.shape[1] == 3


def test_more_channels_than_colours_are_for_the_gaussian_head(trained: dict[str, Tensor]) -> None:
    grid = cube()
    config = replace(CONFIG, super_resolution=4, super_resolution_channels=8)
    head = MeshHead(grid, sphere(grid), torch.ones(len(grid.vertices)), face(), pose(), config, MESH_CONFIG)
    head.geometry.load_state_dict({k[9:]: v for k, v in trained.items() if k.startswith("geometry.")})
    assert head(pose()).colours.shape[1] == 3
