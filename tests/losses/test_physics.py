"""Elasticity and penetration against loops, closed forms and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.losses import elastic_loss, penetration_loss, sample_strand_points
from dynhair.motion import so3_exp
from dynhair.strands import MeshDistance


def random_strands(seed: int = 0, count: int = 4, points: int = 6) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(count, points, 3, generator=generator, dtype=torch.float64).cumsum(dim=1)


def cube(half: float = 0.5) -> MeshDistance:
    """A cube about the origin."""
    corners = torch.tensor([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]) * half
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return MeshDistance(
        corners, torch.tensor([triangle for a, b, c, d in sides for triangle in ([a, b, c], [a, c, d])])
    )


def test_elastic_agrees_with_a_loop() -> None:
    posed, rest = random_strands(0).numpy(), random_strands(1).numpy()
    total = 0.0
    for i in range(4):
        for j in range(5):
            long, short = np.linalg.norm(posed[i, j + 1] - posed[i, j]), np.linalg.norm(rest[i, j + 1] - rest[i, j])
            total += (long - short) ** 2
    found = elastic_loss(random_strands(0), random_strands(1))
    assert found.item() == pytest.approx(total / (4 * 6))


def test_elastic_averages_over_a_batch() -> None:
    first, second, rest = (random_strands(seed) for seed in range(3))
    expected = (elastic_loss(first, rest) + elastic_loss(second, rest)) / 2
    torch.testing.assert_close(elastic_loss(torch.stack([first, second]), rest), expected)


@given(st.integers(0, 10_000))
def test_rigid_motion_costs_nothing_and_adds_nothing(seed: int) -> None:
    posed, rest = random_strands(seed), random_strands(seed + 1)
    generator = torch.Generator().manual_seed(seed)
    turn = so3_exp(torch.randn(3, generator=generator, dtype=torch.float64))
    moved = posed @ turn.T + torch.randn(3, generator=generator, dtype=torch.float64)
    assert elastic_loss(moved, posed).item() < 1e-20
    torch.testing.assert_close(elastic_loss(moved, rest), elastic_loss(posed, rest))


def test_elastic_gradients() -> None:
    assert torch.autograd.gradcheck(elastic_loss, (random_strands(0).requires_grad_(), random_strands(1)))
    collapsed = torch.zeros(2, 4, 3, requires_grad=True)
    elastic_loss(collapsed, torch.ones(2, 4, 3).cumsum(1)).backward()
    assert collapsed.grad is not None
    assert collapsed.grad.isfinite().all()


@pytest.mark.parametrize("shape", [(0, 4, 3), (3, 1, 3)])
def test_strands_without_segments_cost_nothing(shape: tuple[int, int, int]) -> None:
    posed = torch.rand(shape, requires_grad=True)
    loss = elastic_loss(posed, torch.rand(shape))
    loss.backward()
    assert loss.item() == 0
    points = sample_strand_points(posed, 10, generator=torch.Generator())
    assert points.shape == (0, 3)
    assert penetration_loss(points, cube()).item() == 0


def test_penetration_is_the_mean_squared_depth_of_inside_points() -> None:
    points = torch.tensor(
        [[0.4, 0.0, 0.1], [0.0, -0.3, 0.1], [0.0, 0.1, 0.45], [0.7, 0.0, 0.0], [0.0, 2.0, 0.0]], requires_grad=True
    )
    loss = penetration_loss(points, cube())
    assert loss.item() == pytest.approx((0.1**2 + 0.2**2 + 0.05**2) / 3, rel=1e-5)
    loss.backward()
    expected = torch.zeros(5, 3)
    expected[0, 0], expected[1, 1], expected[2, 2] = -0.2 / 3, 0.4 / 3, -0.1 / 3
    assert points.grad is not None
    torch.testing.assert_close(points.grad, expected, rtol=1e-5, atol=1e-6)


def test_penetration_agrees_with_a_loop_over_the_planes_of_a_convex_mesh() -> None:
    """The depth within a convex body is the distance to the nearest of the planes that bound it."""
    corners = np.array([[0.0, 0.0, 1.0], [1.0, -0.2, -0.6], [-0.7, 0.9, -0.5], [-0.5, -1.0, -0.4]])
    faces = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]
    points = np.random.default_rng(0).uniform(-0.8, 0.8, (200, 3))
    squares = []
    for point in points:
        depths = []
        for a, b, c in faces:
            normal = np.cross(corners[b] - corners[a], corners[c] - corners[a])
            depths.append(float((corners[a] - point) @ normal / np.linalg.norm(normal)))
        if min(depths) > 0:
            squares.append(min(depths) ** 2)
    assert 10 < len(squares) < 100
    found = penetration_loss(torch.from_numpy(points), MeshDistance(torch.from_numpy(corners), torch.tensor(faces)))
    assert found.item() == pytest.approx(sum(squares) / len(squares), rel=1e-5)


def test_penetration_gradients_agree_with_finite_differences() -> None:
    mesh, generator = cube(), torch.Generator().manual_seed(0)
    points = (torch.rand(60, 3, generator=generator, dtype=torch.float64) - 0.5) * 1.6
    points.requires_grad_()
    (gradient,) = torch.autograd.grad(penetration_loss(points, mesh), points)
    direction = torch.randn(60, 3, generator=generator, dtype=torch.float64)
    step = 1e-4
    with torch.no_grad():
        ahead, behind = (penetration_loss(points + sign * step * direction, mesh) for sign in (1, -1))
    expected = ((ahead - behind) / (2 * step)).item()
    assert (gradient * direction).sum().item() == pytest.approx(expected, rel=1e-2)


def test_hair_outside_the_head_costs_nothing() -> None:
    points = (torch.tensor([[0.6, 0.0, 0.0], [0.0, 0.0, -3.0]])).requires_grad_()
    loss = penetration_loss(points, cube())
    loss.backward()
    assert loss.item() == 0
    assert points.grad is not None
    assert torch.equal(points.grad, torch.zeros(2, 3))
    assert penetration_loss(torch.zeros(0, 3), cube()).item() == 0


def test_sampled_points_are_different_points_of_the_strands_but_no_roots() -> None:
    strands = torch.arange(20 * 8 * 3, dtype=torch.float32).view(20, 8, 3).requires_grad_()
    points = sample_strand_points(strands, 50, generator=torch.Generator().manual_seed(0))
    assert points.shape == (50, 3)
    rows = (points[:, 0] / 3).long()
    assert len(rows.unique()) == 50
    assert (rows % 8 != 0).all()
    points.sum().backward()
    assert strands.grad is not None
    assert strands.grad.sum() == 150


def test_sampling_follows_its_generator_and_takes_all_of_few_points() -> None:
    strands = random_strands(count=9, points=7)
    first, again, other = (
        sample_strand_points(strands, 20, generator=torch.Generator().manual_seed(seed)) for seed in (1, 1, 2)
    )
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
    everything = sample_strand_points(strands, generator=torch.Generator())
    assert torch.equal(everything, strands[:, 1:].reshape(-1, 3))
