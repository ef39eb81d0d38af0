"""The pull of missing hair, against plain loops in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dynhair.camera import Camera
from dynhair.losses import reach_loss
from dynhair.losses.reach import LIFT, NEAREST

SIZE = 12


def camera(*, turned: float = 0.0) -> Camera:
    """One that looks along +z from a metre away, turned about the y axis."""
    cosine, sine = np.cos(turned), np.sin(turned)
    rotation = torch.tensor([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]], dtype=torch.float64)
    w2c = torch.cat([rotation, torch.tensor([[0.0], [0.0], [1.0]], dtype=torch.float64)], 1)
    intrinsics = torch.tensor([[20.0, 0.0, 6.0], [0.0, 22.0, 6.5], [0.0, 0.0, 1.0]], dtype=torch.float64)
    return Camera(w2c, intrinsics, SIZE, SIZE)


def generators(views: int, seed: int = 0) -> list[torch.Generator]:
    return [torch.Generator().manual_seed(seed + view) for view in range(views)]


def images(views: int = 1) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    return torch.zeros(views, SIZE, SIZE), torch.zeros(views, SIZE, SIZE), torch.zeros(views, SIZE, SIZE)


def goal(seen_from: Camera, row: int, column: int, depth: float) -> np.ndarray:
    """The world point at the middle of a pixel at a depth."""
    ray = np.linalg.inv(seen_from.K.numpy()) @ np.array([column + 0.5, row + 0.5, 1.0])
    return (ray * depth - seen_from.w2c[:, 3].numpy()) @ seen_from.w2c[:, :3].numpy()


def nearest_distances(points: torch.Tensor, place: np.ndarray) -> float:
    return float(np.sort(np.linalg.norm(points.numpy() - place, axis=1))[:NEAREST].mean())


def strand_points(count: int = 60) -> torch.Tensor:
    return 0.1 * torch.randn(count, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(5))


def test_hair_that_is_missing_on_a_surface_lies_just_before_it() -> None:
    seen_from, points = camera(turned=0.3), strand_points()
    missing, surface, depth = images()
    missing[0, 4, 7], surface[0, 4, 7], depth[0, 4, 7] = 0.8, 0.9, 1.05
    value = reach_loss(points, [seen_from], missing, surface, depth, samples=5, generators=generators(1))
    expected = nearest_distances(points, goal(seen_from, 4, 7, float(depth[0, 4, 7]) - LIFT))
    assert float(value) == pytest.approx(expected * 0.8 / SIZE**2, rel=1e-5)


def test_before_nothing_it_is_as_far_as_the_nearest_strand_in_the_image() -> None:
    seen_from, points = camera(turned=-0.2), strand_points()
    missing, surface, depth = images()
    missing[0, 10, 2] = 1.0
    value = reach_loss(points, [seen_from], missing, surface, depth, samples=3, generators=generators(1))
    seen = points.numpy() @ seen_from.w2c[:, :3].numpy().T + seen_from.w2c[:, 3].numpy()
    ray = np.linalg.inv(seen_from.K.numpy()) @ np.array([2.5, 10.5, 1.0])
    beside = seen[np.argmin(np.linalg.norm(seen[:, :2] / seen[:, 2:] - ray[:2], axis=1)), 2]
    expected = nearest_distances(points, goal(seen_from, 10, 2, float(beside)))
    assert float(value) == pytest.approx(expected / SIZE**2, rel=1e-5)


def test_sampled_pixels_stand_for_all_of_all_views() -> None:
    cameras, points = [camera(), camera(turned=0.4)], strand_points()
    missing, surface, depth = images(2)
    missing[0, 2, 3], missing[0, 9, 8], missing[1, 5, 5] = 0.4, 0.9, 0.6
    surface[:], depth[:] = 1.0, 1.1
    value = reach_loss(points, cameras, missing, surface, depth, samples=20_000, generators=generators(2))
    away = float(depth[0, 0, 0]) - LIFT
    expected = sum(
        float(missing[view, row, column]) * nearest_distances(points, goal(cameras[view], row, column, away))
        for view, row, column in ((0, 2, 3), (0, 9, 8), (1, 5, 5))
    )
    assert float(value) == pytest.approx(expected / SIZE**2 / 2, rel=0.01)


def test_gradients_are_those_of_finite_differences() -> None:
    cameras, points = [camera(), camera(turned=0.4)], strand_points().requires_grad_()
    missing, surface, depth = images(2)
    missing[0, 2, 3], missing[1, 9, 8] = 1.0, 0.7
    surface[:], depth[:] = 1.0, 1.0

    def loss(moved: torch.Tensor) -> torch.Tensor:
        return reach_loss(moved, cameras, missing, surface, depth, samples=8, generators=generators(2))

    assert torch.autograd.gradcheck(loss, points, eps=1e-7, atol=1e-7)


def test_strands_behind_a_shoulder_come_to_lie_before_it() -> None:
    points = (torch.tensor([[0.0, 0.0, 0.08]]) + 0.01 * strand_points(20).float()).requires_grad_()
    missing, surface, depth = images()
    missing[0, 6, 6], surface[0, 6, 6], depth[0, 6, 6] = 1.0, 1.0, 1.0  # at z = 0 in the world
    optimizer = torch.optim.Adam([points], 0.005)
    for step in range(60):
        optimizer.zero_grad()
        reach_loss(points, [camera()], missing, surface, depth, samples=4, generators=generators(1, step)).backward()
        optimizer.step()
    assert int((points.detach()[:, 2] < 0).sum()) >= NEAREST


@pytest.mark.parametrize("amount", [0.0, 0.29, -1.0])
def test_where_little_is_missing_nothing_moves(amount: float) -> None:
    points = strand_points().requires_grad_()
    missing, surface, depth = images()
    missing[:] = amount
    assert float(reach_loss(points, [camera()], missing, surface, depth, samples=4, generators=generators(1))) == 0.0


def test_without_strands_there_is_nothing_to_draw() -> None:
    missing, surface, depth = images()
    missing[:] = 1.0
    value = reach_loss(torch.zeros(0, 3), [camera()], missing, surface, depth, samples=4, generators=generators(1))
    assert float(value) == 0.0


def test_fewer_points_than_a_pixel_draws_are_all_drawn() -> None:
    points = strand_points(2)
    missing, surface, depth = images()
    missing[0, 4, 7], surface[0, 4, 7], depth[0, 4, 7] = 1.0, 1.0, 1.05
    value = reach_loss(points, [camera()], missing, surface, depth, samples=1, generators=generators(1))
    expected = np.linalg.norm(points.numpy() - goal(camera(), 4, 7, float(depth[0, 4, 7]) - LIFT), axis=1).mean()
    assert float(value) == pytest.approx(expected / SIZE**2, rel=1e-5)


def test_points_that_are_not_finite_spoil_the_loss_and_nothing_else() -> None:
    points = strand_points()
    points[::2] = torch.nan
    missing, surface, depth = images()
    missing[0, 4, 7] = 1.0
    value = reach_loss(points, [camera()], missing, surface, depth, samples=3, generators=generators(1))
    assert value.shape == ()
    surface[0, 4, 7], depth[0, 4, 7] = 1.0, torch.nan
    value = reach_loss(strand_points(), [camera()], missing, surface, depth, samples=3, generators=generators(1))
    assert value.isnan()
