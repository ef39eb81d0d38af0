"""Surfaces from signed distances, against closed forms, finite differences and what every surface must be."""

from __future__ import annotations

import math

import pytest
import torch
from closed_surfaces import area, ball, cube, euler_characteristic, face_normals, is_closed, torus_distance, volume
from hypothesis import given
from hypothesis import strategies as st

from dynhair.mesh import Surface, TetrahedralGrid, marching_tetrahedra


def surface_of(grid: TetrahedralGrid, sdf: torch.Tensor) -> Surface:
    return marching_tetrahedra(grid.vertices, sdf, grid.tetrahedra)


def bumps(grid: TetrahedralGrid, seed: int) -> torch.Tensor:
    """A smooth field that is negative in several places and positive at the sides of the grid."""
    generator = torch.Generator().manual_seed(seed)
    waves = 4 * torch.randn(3, 12, generator=generator, dtype=torch.float64)
    phases, heights = torch.rand(2, 12, generator=generator, dtype=torch.float64)
    field = 0.2 - ((grid.vertices @ waves + 2 * math.pi * phases).sin() * heights).sum(1) / 3
    return torch.maximum(field, grid.vertices.abs().amax(1) - 0.9)


def test_a_sphere_is_closed_and_has_its_area_and_volume() -> None:
    sphere = ball(0.1, 20)
    assert is_closed(sphere.faces)
    assert euler_characteristic(sphere) == 2
    assert float(area(sphere)) == pytest.approx(4 * math.pi * 0.1**2, rel=0.01)
    assert float(volume(sphere)) == pytest.approx(4 / 3 * math.pi * 0.1**3, rel=0.015)
    torch.testing.assert_close(
        sphere.vertices.norm(dim=1), torch.full_like(sphere.vertices[:, 0], 0.1), rtol=0.01, atol=0
    )


def test_a_torus_has_a_hole() -> None:
    grid = cube(1.0, 24)
    torus = surface_of(grid, torus_distance(grid.vertices, 0.6, 0.25))
    assert is_closed(torus.faces)
    assert euler_characteristic(torus) == 0
    assert float(area(torus)) == pytest.approx(4 * math.pi**2 * 0.6 * 0.25, rel=0.02)
    assert float(volume(torus)) == pytest.approx(2 * math.pi**2 * 0.6 * 0.25**2, rel=0.03)


def test_a_plane_is_cut_exactly_and_ends_at_the_grid() -> None:
    grid = cube(1.0, 5)
    normal = torch.tensor([0.48, 0.6, 0.64], dtype=torch.float64)
    plane = surface_of(grid, grid.vertices @ normal - 0.1)
    torch.testing.assert_close(plane.vertices @ normal, torch.full_like(plane.vertices[:, 0], 0.1))
    normals = face_normals(plane)
    along = normals @ normal
    torch.testing.assert_close(along, normals.norm(dim=1))
    assert not is_closed(plane.faces)


@given(st.integers(0, 10_000), st.integers(2, 7))
def test_surfaces_of_any_field_are_closed_and_face_outwards(seed: int, resolution: int) -> None:
    grid = cube(1.0, resolution)
    sdf = bumps(grid, seed)
    surface = surface_of(grid, sdf)
    assert is_closed(surface.faces)
    assert euler_characteristic(surface) % 2 == 0
    inner, outer = surface.parents.unbind(1)
    assert (sdf[inner] < 0).all()
    assert (sdf[outer] >= 0).all()
    outwards = (grid.vertices[outer] - grid.vertices[inner])[surface.faces]
    assert ((outwards * face_normals(surface)[:, None]).sum(2) >= -1e-12).all()
    assert set(surface.faces.flatten().tolist()) == set(range(len(surface.vertices)))
    assert (surface.weights >= 0).all()
    torch.testing.assert_close(surface.weights.sum(1), torch.ones_like(surface.weights[:, 0]))


def test_attributes_follow_the_vertices() -> None:
    grid = cube(1.0, 4)
    sphere = surface_of(grid, grid.vertices.norm(dim=1) - 0.7)
    torch.testing.assert_close(sphere.interpolate(grid.vertices), sphere.vertices)
    torch.testing.assert_close(
        sphere.interpolate(torch.ones(len(grid.vertices), 2).double()), torch.ones(len(sphere.vertices), 2).double()
    )


def test_gradients_agree_with_finite_differences() -> None:
    grid = cube(1.0, 2)
    positions = grid.vertices + 0.05 * torch.randn(grid.vertices.shape, generator=torch.Generator().manual_seed(0))
    sdf = (grid.vertices.norm(dim=1) - 0.8).requires_grad_()

    def vertices_and_weights(positions: torch.Tensor, sdf: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        surface = marching_tetrahedra(positions, sdf, grid.tetrahedra)
        return surface.vertices, surface.weights

    assert torch.autograd.gradcheck(vertices_and_weights, (positions.requires_grad_(), sdf))


def test_a_volume_grows_by_its_area() -> None:
    grid = cube(0.13, 16)
    sdf = (grid.vertices.norm(dim=1) - 0.1).requires_grad_()
    sphere = surface_of(grid, sdf)
    (gradient,) = torch.autograd.grad(volume(sphere), sdf)
    assert float(-gradient.sum()) == pytest.approx(float(area(sphere).detach()), rel=0.01)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_surface_through_grid_vertices_is_closed_and_finite(dtype: torch.dtype) -> None:
    grid = cube(1.0, 4, dtype)
    sdf = (grid.vertices.abs().sum(1) - 1).requires_grad_()
    assert (sdf == 0).sum() > 10
    positions = grid.vertices.clone().requires_grad_()
    octahedron = marching_tetrahedra(positions, sdf, grid.tetrahedra)
    assert is_closed(octahedron.faces)
    assert float(volume(octahedron).detach()) == pytest.approx(4 / 3, rel=0.1)
    octahedron.vertices.square().sum().backward()
    assert sdf.grad is not None
    assert positions.grad is not None
    assert torch.isfinite(sdf.grad).all()
    assert torch.isfinite(positions.grad).all()


@pytest.mark.parametrize("tiny", [0.0, 1e-45, 1e-30, 1e-9])
def test_gradients_are_finite_however_small_the_distances(tiny: float) -> None:
    grid = cube(1.0, 2, torch.float32)
    sdf = torch.where(grid.vertices.norm(dim=1) < 0.9, -max(tiny, 1e-45), tiny).requires_grad_()
    surface = surface_of(grid, sdf)
    assert len(surface.vertices)
    assert torch.isfinite(surface.vertices).all()
    surface.vertices.sum().backward()
    assert sdf.grad is not None
    assert torch.isfinite(sdf.grad).all()


@pytest.mark.parametrize("value", [-1.0, 0.0, 1.0])
def test_where_no_sign_changes_there_is_no_surface(value: float) -> None:
    grid = cube(1.0, 2)
    nothing = surface_of(grid, torch.full_like(grid.vertices[:, 0], value))
    assert nothing.vertices.shape == (0, 3)
    assert nothing.faces.shape == (0, 3)
    assert nothing.parents.shape == (0, 2)
    assert nothing.weights.shape == (0, 2)
