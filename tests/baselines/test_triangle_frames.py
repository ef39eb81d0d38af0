"""The frames of triangles: what is bound to them moves as they do."""

from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.baselines.triangle_frames import LEAST_SIZE, TriangleFrames, triangle_frames
from dynhair.motion import so3_exp

RIGHT = torch.tensor([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.5, 0.0]], dtype=torch.float64)
FACE = torch.tensor([[0, 1, 2]])
angle = st.floats(-4, 4)
vectors = st.tuples(angle, angle, angle)


def some_mesh() -> tuple[torch.Tensor, torch.Tensor]:
    random = torch.Generator().manual_seed(0)
    return torch.randn(12, 3, generator=random, dtype=torch.float64), torch.randperm(12, generator=random).view(4, 3)


def test_a_right_triangle_has_the_frame_that_geometry_says() -> None:
    origins, rotations, sizes = triangle_frames(RIGHT, FACE)
    torch.testing.assert_close(origins, RIGHT.mean(0, keepdim=True))
    # along x, the normal z, and their product -y, as columns
    expected = torch.tensor([[[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]], dtype=torch.float64)
    torch.testing.assert_close(rotations, expected)
    torch.testing.assert_close(sizes, torch.tensor([(0.3 + 0.5) / 2], dtype=torch.float64))


@given(vectors, vectors, st.floats(0.2, 5))
def test_bound_points_follow_every_motion_of_the_mesh_and_its_size(
    turn: tuple[float, ...], move: tuple[float, ...], grow: float
) -> None:
    vertices, faces = some_mesh()
    rotation = so3_exp(torch.tensor(turn, dtype=torch.float64))
    offset = torch.tensor(move, dtype=torch.float64)
    local = torch.randn(len(faces), 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    before = triangle_frames(vertices, faces)
    after = triangle_frames(grow * vertices @ rotation.T + offset, faces)
    torch.testing.assert_close(after.to_world(local), grow * before.to_world(local) @ rotation.T + offset)
    torch.testing.assert_close(after.rotations, rotation @ before.rotations)
    torch.testing.assert_close(after.sizes, grow * before.sizes)


def test_axes_are_rotations_and_local_places_are_the_inverse_of_world_places() -> None:
    vertices, faces = some_mesh()
    frames = triangle_frames(vertices, faces)
    identity = torch.eye(3, dtype=torch.float64).expand(len(faces), 3, 3)
    torch.testing.assert_close(frames.rotations.mT @ frames.rotations, identity)
    torch.testing.assert_close(torch.linalg.det(frames.rotations), torch.ones(len(faces), dtype=torch.float64))
    points = torch.randn(len(faces), 3, dtype=torch.float64)
    torch.testing.assert_close(frames.to_world(frames.to_local(points)), points)


def test_some_frames_are_those_of_these_triangles() -> None:
    vertices, faces = some_mesh()
    rows = torch.tensor([2, 0, 2])
    for some, expected in zip(
        triangle_frames(vertices, faces)[rows], triangle_frames(vertices, faces[rows]), strict=True
    ):
        assert torch.equal(some, expected)


def test_gradients_of_the_vertices_are_right() -> None:
    vertices, faces = some_mesh()
    local = torch.randn(len(faces), 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def placed(v: torch.Tensor, at: torch.Tensor) -> torch.Tensor:
        return triangle_frames(v, faces).to_world(at)

    assert torch.autograd.gradcheck(placed, (vertices.requires_grad_(), local.requires_grad_()))


def test_a_collapsed_triangle_is_finite_and_so_are_its_gradients() -> None:
    vertices = torch.zeros(3, 3, requires_grad=True)
    frames = triangle_frames(vertices, FACE)
    assert frames.sizes.item() == torch.tensor(LEAST_SIZE)
    places = frames.to_world(torch.ones(1, 3))
    places.sum().backward()
    assert isinstance(frames, TriangleFrames)
    assert vertices.grad is not None
    assert places.isfinite().all()
    assert vertices.grad.isfinite().all()
