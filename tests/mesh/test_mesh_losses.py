"""Losses and distances of surfaces, against loops, SciPy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from closed_surfaces import ball
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from dynhair.errors import DynhairError
from dynhair.mesh import chamfer, laplacian_loss, silhouette_iou_loss, surface_samples

SQUARE = torch.tensor([[0, 1, 2], [0, 2, 3]])


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@pytest.mark.parametrize("faces", [SQUARE, ball(1.0, 4).faces], ids=["open", "closed"])
def test_the_laplacian_agrees_with_a_loop(faces: torch.Tensor) -> None:
    vertices = random(int(faces.max()) + 1, 3)
    total = 0.0
    for vertex, position in enumerate(vertices):
        ring = {other for face in faces.tolist() if vertex in face for other in face} - {vertex}
        total += float((vertices[sorted(ring)].mean(0) - position).square().sum())
    assert float(laplacian_loss(vertices, faces)) == pytest.approx(total / len(vertices))


def test_the_laplacian_is_a_square_of_lengths() -> None:
    sphere = ball(0.1, 8)
    shifted = 3 * sphere.vertices + torch.tensor([1.0, 2.0, 3.0])
    torch.testing.assert_close(laplacian_loss(shifted, sphere.faces), 9 * laplacian_loss(sphere.vertices, sphere.faces))


def test_vertices_without_faces_and_empty_meshes_are_smooth() -> None:
    none = torch.zeros(0, 3, dtype=torch.int64)
    assert float(laplacian_loss(random(5, 3), none)) == 0
    assert float(laplacian_loss(torch.zeros(0, 3), none)) == 0


def test_laplacian_gradients_agree_with_finite_differences() -> None:
    faces = ball(1.0, 2).faces
    vertices = random(int(faces.max()) + 1, 3).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: laplacian_loss(v, faces), vertices)


def test_smoothing_rounds_a_rough_sphere() -> None:
    sphere = ball(1.0, 8)
    vertices = (sphere.vertices + 0.05 * (random(len(sphere.vertices), 3) - 0.5)).requires_grad_()
    rough = float(vertices.detach().norm(dim=1).std())
    optimizer = torch.optim.Adam([vertices], lr=3e-3)
    for _ in range(15):
        optimizer.zero_grad()
        (100 * laplacian_loss(vertices, sphere.faces)).backward()
        optimizer.step()
    assert float(vertices.detach().norm(dim=1).std()) < 0.7 * rough


def test_the_iou_agrees_with_sets() -> None:
    predicted, target = (random(2, 3, 6, 5) > 0.5).double()
    expected = []
    for p, t in zip(predicted.numpy() > 0, target.numpy() > 0, strict=True):
        expected.append(1 - (p & t).sum() / (p | t).sum())
    assert float(silhouette_iou_loss(predicted, target)) == pytest.approx(float(np.mean(expected)))


def test_pixels_that_are_not_counted_do_not_matter() -> None:
    predicted, target, other = random(3, 2, 4, 6)
    counted = torch.ones_like(target)
    counted[..., :2] = 0
    there = torch.where(counted > 0, predicted, other)
    expected = silhouette_iou_loss(predicted[..., 2:], target[..., 2:])
    torch.testing.assert_close(silhouette_iou_loss(predicted, target, counted), expected)
    torch.testing.assert_close(silhouette_iou_loss(there, target, counted), expected)


@given(st.integers(0, 1000))
def test_the_iou_loss_is_in_its_range_and_symmetric(seed: int) -> None:
    predicted, target = random(2, 4, 4, seed=seed).round(decimals=1)
    loss = float(silhouette_iou_loss(predicted, target))
    assert 0 <= loss <= 1
    assert loss == pytest.approx(float(silhouette_iou_loss(target, predicted)))
    hard = (target > 0.5).double()
    assert float(silhouette_iou_loss(hard, hard)) == 0


def test_the_iou_of_empty_masks_is_finite() -> None:
    predicted = torch.zeros(2, 4, 4, requires_grad=True)
    loss = silhouette_iou_loss(predicted, torch.zeros(2, 4, 4))
    loss.backward()
    assert float(loss.detach()) == 0
    assert predicted.grad is not None
    assert torch.isfinite(predicted.grad).all()
    assert float(silhouette_iou_loss(torch.full((4, 4), 0.5), torch.zeros(4, 4))) == 1


def test_iou_gradients_agree_with_finite_differences() -> None:
    predicted, target, counted = random(3, 2, 3, 4)
    assert torch.autograd.gradcheck(silhouette_iou_loss, (predicted.requires_grad_(), target, counted))


def test_chamfer_agrees_with_all_pairs() -> None:
    a, b = random(50, 3), random(70, 3, seed=1)
    distances = cdist(a.numpy(), b.numpy())
    expected = (distances.min(0).mean() + distances.min(1).mean()) / 2
    assert chamfer(a, b) == pytest.approx(expected)
    assert chamfer(b.float(), a.float().requires_grad_()) == pytest.approx(expected, rel=1e-5)
    assert chamfer(a, a) == 0


def test_chamfer_of_concentric_spheres_is_their_distance() -> None:
    small, large = ball(0.10, 16), ball(0.11, 16)
    a, b = (surface_samples(s.vertices, s.faces, 20_000, 0) for s in (small, large))
    assert chamfer(a, b) == pytest.approx(0.01, rel=0.03)


def test_samples_are_spread_by_area() -> None:
    vertices = torch.tensor([[0.0, 0, 0], [3, 0, 0], [3, 1, 0], [0, 4, 0]])
    points = surface_samples(vertices, SQUARE, 11_000, 5)
    in_first = points[:, 1] < points[:, 0] / 3
    assert int(in_first.sum()) == pytest.approx(11_000 * 1.5 / 7.5, abs=2)
    assert torch.equal(points, surface_samples(vertices, SQUARE, 11_000, 5))
    assert not torch.equal(points, surface_samples(vertices, SQUARE, 11_000, 6))


@pytest.mark.parametrize("faces", [SQUARE[:0], SQUARE], ids=["no faces", "no area"])
def test_a_surface_without_area_has_no_samples(faces: torch.Tensor) -> None:
    with pytest.raises(DynhairError, match="no area"):
        surface_samples(torch.zeros(4, 3), faces, 10, 0)


def test_chamfer_needs_points() -> None:
    with pytest.raises(DynhairError, match="0 points and 3"):
        chamfer(torch.zeros(0, 3), torch.zeros(3, 3))
