"""What is checked of surfaces, and signed distances to make them of."""

from __future__ import annotations

import torch
from torch import Tensor

from dynhair.mesh import Surface, TetrahedralGrid, marching_tetrahedra


def cube(half_side: float, resolution: int, dtype: torch.dtype = torch.float64) -> TetrahedralGrid:
    """A grid about the origin."""
    high = torch.full((3,), half_side, dtype=dtype)
    return TetrahedralGrid.of(-high, high, resolution)


def ball(radius: float, resolution: int = 12, dtype: torch.dtype = torch.float64) -> Surface:
    grid = cube(1.3 * radius, resolution, dtype)
    return marching_tetrahedra(grid.vertices, grid.vertices.norm(dim=1) - radius, grid.tetrahedra)


def torus_distance(points: Tensor, ring: float, tube: float) -> Tensor:
    return torch.hypot(points[:, [0, 2]].norm(dim=1) - ring, points[:, 1]) - tube


def directed_edges(faces: Tensor) -> list[tuple[int, int]]:
    return [tuple(edge) for edge in torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()]


def is_closed(faces: Tensor) -> bool:
    """Every edge is in two faces, which run along it in opposite directions."""
    edges = directed_edges(faces)
    return len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)


def euler_characteristic(surface: Surface) -> int:
    edges = {frozenset(edge) for edge in directed_edges(surface.faces)}
    return len(surface.vertices) - len(edges) + len(surface.faces)


def face_normals(surface: Surface) -> Tensor:
    """As long as twice the faces' areas."""
    a, b, c = surface.vertices[surface.faces].unbind(1)
    return torch.linalg.cross(b - a, c - a)


def area(surface: Surface) -> Tensor:
    return face_normals(surface).norm(dim=1).sum() / 2


def volume(surface: Surface) -> Tensor:
    return (surface.vertices[surface.faces[:, 0]] * face_normals(surface)).sum() / 6
