"""The signed distance on a grid, against a sphere's closed form."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial import ConvexHull

from dynhair.hairstyles import HeadField

_RADIUS = 0.1


@pytest.fixture(scope="module")
def field():
    # A Fibonacci lattice: triangles of even size.
    rank = np.arange(4000) + 0.5
    height, angle = 1 - rank / 2000, np.pi * (1 + 5**0.5) * rank
    flat = np.sqrt(1 - height**2)
    points = _RADIUS * np.stack([flat * np.cos(angle), height, flat * np.sin(angle)], axis=1)
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].swapaxes(0, 1)
    inwards = (np.cross(b - a, c - a) * a).sum(1) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return HeadField.of(torch.from_numpy(points).float(), torch.from_numpy(faces.astype(np.int64)))


def _places(low: float, high: float) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    way = torch.nn.functional.normalize(torch.randn(500, 3, generator=generator), dim=1)
    way[:, 1] = way[:, 1].abs()  # the grid keeps away from the lower rim of a mesh
    return way, way * (low + (high - low) * torch.rand(500, 1, generator=generator))


def test_distances_and_normals_are_those_of_the_sphere(field):
    way, places = _places(0.09, 0.13)
    distance, normal = field.query(places)
    torch.testing.assert_close(distance, places.norm(dim=1) - _RADIUS, rtol=0, atol=5e-4)
    assert ((normal * way).sum(1) > 0.99).all()


def test_points_are_pushed_to_their_clearance_and_no_farther(field):
    _, places = _places(0.08, 0.13)
    clearance = torch.full((500,), 0.005)
    pushed = field.push_out(places, clearance)
    expected = places.norm(dim=1).clamp_min(_RADIUS + 0.005)
    torch.testing.assert_close(pushed.norm(dim=1), expected, rtol=0, atol=8e-4)
