"""Triangles drawn as Gaussians, against their moments, finite differences and the discs that spheres look like."""

from __future__ import annotations

import pytest
import torch
from closed_surfaces import ball, cube
from hypothesis import given
from hypothesis import strategies as st

from dynhair.camera import Camera
from dynhair.mesh import marching_tetrahedra, silhouette_iou_loss, triangle_gaussians
from dynhair.mesh.gaussians import SPREAD, THICKNESS
from dynhair.render import Gaussians, rasterize
from dynhair.render.reference import quaternion_matrix

DISTANCE = 1.0
RADIUS = 0.1
DEGENERATE = {
    "a point": [[0.1, 0.2, 0.3]] * 3,
    "a line": [[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]],
    "a slanted line": [[0.0, 0, 0], [0.001, 0.003, -0.002], [0.002, 0.006, -0.004]],
    "two corners in one": [[0.0, 0, 0], [0.0, 0, 0], [0.0, 0.01, 0]],
    "nearly a line": [[0.0, 0, 0], [0.01, 0, 0], [0.02, 1e-9, 0]],
    "nearly a point": [[0.0, 0, 0], [1e-20, 0, 0], [0, 1e-20, 0]],
    "equilateral": [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]],
    "facing down": [[0.0, 0, 0], [0, 0.01, 0], [0.01, 0, 0]],
}


def random_triangles(count: int, seed: int = 0, size: float = 0.01) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    centres = torch.randn(count, 1, 3, generator=generator, dtype=torch.float64)
    return (centres + size * torch.randn(count, 3, 3, generator=generator, dtype=torch.float64)).reshape(-1, 3)


def as_gaussians(vertices: torch.Tensor) -> Gaussians:
    """Of triangles that share no vertices."""
    faces = torch.arange(len(vertices)).reshape(-1, 3)
    return triangle_gaussians(vertices, faces, torch.ones(len(faces), 2, dtype=vertices.dtype))


def view(size: int, dtype: torch.dtype = torch.float32) -> Camera:
    w2c = torch.eye(4, dtype=dtype)[:3].clone()
    w2c[2, 3] = DISTANCE
    focal = 3.57 * size
    K = torch.tensor([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]], dtype=dtype)
    return Camera(w2c, K, size, size)


def seen_radius(size: int, radius: float = RADIUS) -> float:
    """Of a sphere's silhouette, pixels."""
    return 3.57 * size * radius / (DISTANCE**2 - radius**2) ** 0.5


def from_centre(size: int, samples: int = 1) -> torch.Tensor:
    places = (torch.arange(size * samples) + 0.5) / samples - size / 2
    return torch.hypot(places[:, None], places[None])


def disc(size: int, radius: float) -> torch.Tensor:
    """With the share of each pixel that lies in it."""
    fine = (from_centre(size, 8) < radius).float()
    return torch.nn.functional.avg_pool2d(fine[None], 8)[0]


@given(st.integers(0, 10_000), st.sampled_from([1e-3, 1e-2, 1.0]))
def test_moments_are_those_of_the_triangles(seed: int, size: float) -> None:
    vertices = random_triangles(20, seed, size)
    gaussians = as_gaussians(vertices)
    a, b, c = vertices.reshape(-1, 3, 3).unbind(1)
    centres = (a + b + c) / 3
    # The midpoints of the sides integrate second moments exactly.
    middles = torch.stack([a + b, b + c, c + a], dim=1) / 2 - centres[:, None]
    expected = SPREAD**2 * middles.mT @ middles / 3 + THICKNESS**2 * torch.eye(3, dtype=torch.float64)
    axes = quaternion_matrix(gaussians.quats) * gaussians.scales[:, None]
    torch.testing.assert_close(gaussians.means, centres)
    torch.testing.assert_close(axes @ axes.mT, expected, rtol=1e-9, atol=1e-9 * size**2)
    assert (gaussians.scales[:, 0] >= gaussians.scales[:, 1] * (1 - 1e-9)).all()
    assert (gaussians.scales[:, 2] == THICKNESS).all()
    normals = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1)
    along = (quaternion_matrix(gaussians.quats)[:, :, 2] * normals).sum(1).abs()
    torch.testing.assert_close(along, torch.ones_like(along))


def test_colours_are_the_features() -> None:
    colours = torch.rand(4, 7)
    faces = torch.arange(12).reshape(4, 3)
    gaussians = triangle_gaussians(random_triangles(4).float(), faces, colours)
    assert torch.equal(gaussians.features, colours)


def test_gradients_of_means_and_scales_agree_with_finite_differences() -> None:
    vertices = random_triangles(6).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: (as_gaussians(v).means, as_gaussians(v).scales), vertices, eps=1e-7)
    assert not as_gaussians(vertices).quats.requires_grad


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_triangles_without_area_are_finite(name: str, dtype: torch.dtype) -> None:
    vertices = torch.tensor(DEGENERATE[name], dtype=dtype, requires_grad=True)
    gaussians = as_gaussians(vertices)
    for values in (gaussians.means, gaussians.quats, gaussians.scales):
        assert torch.isfinite(values).all()
    torch.testing.assert_close(gaussians.quats.norm(dim=1), torch.ones(1, dtype=dtype))
    longest = (vertices - vertices.roll(1, 0)).norm(dim=1).max()
    assert gaussians.scales.max() <= SPREAD * longest + 2 * THICKNESS
    (gaussians.means.sum() + gaussians.scales.square().sum() + gaussians.scales.sum()).backward()
    assert vertices.grad is not None
    assert torch.isfinite(vertices.grad).all()


@given(st.lists(st.sampled_from([0.0, 1e-30, 1e-9, 1e-3, -1e-3, 1.0]), min_size=9, max_size=9))
def test_any_triangle_is_finite(coordinates: list[float]) -> None:
    vertices = torch.tensor(coordinates).reshape(3, 3).requires_grad_()
    gaussians = as_gaussians(vertices)
    (gradient,) = torch.autograd.grad(gaussians.means.sum() + gaussians.scales.sum(), vertices)
    for values in (gaussians.means, gaussians.quats, gaussians.scales, gradient):
        assert torch.isfinite(values).all()


def test_no_triangles_are_no_gaussians() -> None:
    gaussians = triangle_gaussians(torch.zeros(0, 3), torch.zeros(0, 3, dtype=torch.int64), torch.zeros(0, 3))
    assert gaussians.means.shape == gaussians.scales.shape == (0, 3)
    assert gaussians.quats.shape == (0, 4)


@pytest.mark.parametrize("resolution", [14, 24, 40])
def test_a_sphere_looks_like_a_disc_without_holes(resolution: int) -> None:
    sphere, size = ball(RADIUS, resolution, torch.float32), 512
    colours = torch.full((len(sphere.faces), 1), 0.5)
    rendering = rasterize(triangle_gaussians(sphere.vertices, sphere.faces, colours), view(size))
    truth = disc(size, seen_radius(size))
    assert 1 - float(silhouette_iou_loss(rendering.alpha[0], truth)) > 0.98
    inside = from_centre(size) < seen_radius(size) - 5
    assert rendering.alpha[0][inside].min() > 0.97
    assert rendering.features[0, ..., 0][inside].min() > 0.48
    assert rendering.alpha[0][from_centre(size) > seen_radius(size) + 5].max() < 0.05


def test_a_finer_drawing_has_a_narrower_silhouette() -> None:
    sphere, size = ball(RADIUS, 24, torch.float32), 256
    gaussians = triangle_gaussians(sphere.vertices, sphere.faces, torch.ones(len(sphere.faces), 1))
    plain, finer = rasterize(gaussians, view(size)).alpha, rasterize(gaussians, view(2 * size)).alpha
    averaged = torch.nn.functional.avg_pool2d(finer, 2)
    beyond, beyond_averaged = (
        float((alpha.sum() / torch.pi).sqrt()) - seen_radius(size) for alpha in (plain, averaged)
    )
    assert 0.5 < beyond < 1
    assert 0 < beyond_averaged < beyond - 0.2
    assert 1 - float(silhouette_iou_loss(averaged[0], disc(size, seen_radius(size)))) > 0.98


def silhouette_loss(radius: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Of a sphere, drawn by the reference in double precision."""
    sphere = ball(1.0, 5)
    gaussians = triangle_gaussians(sphere.vertices * radius, sphere.faces, torch.ones(len(sphere.faces), 1).double())
    size = target.shape[0]
    return silhouette_iou_loss(rasterize(gaussians, view(size, torch.float64), backend="reference").alpha[0], target)


@pytest.mark.parametrize(("aim", "sign"), [(0.08, 1), (0.12, -1)])
def test_a_silhouette_draws_a_sphere_to_its_size(aim: float, sign: int) -> None:
    target = disc(24, seen_radius(24, aim)).double()
    radius = torch.tensor(RADIUS, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(silhouette_loss(radius, target), radius)
    assert gradient.sign() == sign
    step = 1e-6
    with torch.no_grad():
        difference = silhouette_loss(radius + step, target) - silhouette_loss(radius - step, target)
    assert float(gradient) == pytest.approx(float(difference) / (2 * step), rel=1e-3)


@pytest.mark.parametrize(("aim", "grows"), [(0.08, False), (0.12, True)])
def test_a_silhouette_moves_the_signed_distance(aim: float, grows: bool) -> None:
    grid, size = cube(0.14, 14, torch.float32), 96
    distance = grid.vertices.norm(dim=1)
    offset = torch.tensor(-RADIUS, requires_grad=True)
    target = disc(size, seen_radius(size, aim))
    optimizer = torch.optim.Adam([offset], lr=2e-3)
    for _ in range(25):
        surface = marching_tetrahedra(grid.vertices, distance + offset, grid.tetrahedra)
        gaussians = triangle_gaussians(surface.vertices, surface.faces, torch.ones(len(surface.faces), 1))
        loss = silhouette_iou_loss(rasterize(gaussians, view(size)).alpha[0], target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert (float(-offset.detach()) > RADIUS) == grows
    assert float(-offset.detach()) == pytest.approx(aim, abs=0.006)
