"""Signed distances against brute force: exact triangle distances and winding numbers in float64."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import torch
from meshes import sphere

from dynhair.strands import MeshDistance, push_out


def points_about(radius: float, count: int = 400, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
    return directions * radius * (0.2 + 1.6 * torch.rand(count, 1, generator=generator))


def winding_numbers(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Sums of signed solid angles (Van Oosterom and Strackee) over 4 pi."""
    a, b, c = (triangles[None] - points[:, None, None]).transpose(2, 0, 1, 3)
    la, lb, lc = (np.linalg.norm(edge, axis=-1) for edge in (a, b, c))
    volume = (a * np.cross(b, c)).sum(-1)
    cosine = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return (2 * np.arctan2(volume, cosine)).sum(1) / (4 * np.pi)


def distances_to_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The least of the distances to the triangles' edges, and to their planes where the foot is inside."""
    p, (a, b, c) = points[:, None], triangles.transpose(1, 0, 2)
    best = np.full((len(points), len(triangles)), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        along = (((p - start) * edge).sum(-1) / (edge * edge).sum(-1)).clip(0, 1)
        best = np.minimum(best, np.linalg.norm(p - start - along[..., None] * edge, axis=-1))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    inside = np.ones_like(best, dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(end - start, p - start) * normal).sum(-1) >= 0
    plane = np.abs(((p - a) * normal).sum(-1))
    return np.where(inside, np.minimum(best, plane), best).min(axis=1)


def check(vertices: torch.Tensor, faces: torch.Tensor, points: torch.Tensor, mesh: MeshDistance) -> None:
    triangles = vertices[faces].double().numpy()
    distance, closest = mesh.query(points)
    exact = distances_to_triangles(points.double().numpy(), triangles)
    np.testing.assert_allclose(distance.abs(), exact, atol=1e-6)
    np.testing.assert_allclose(distances_to_triangles(closest.double().numpy(), triangles), 0, atol=1e-6)
    torch.testing.assert_close((points - closest).norm(dim=1), distance.abs(), rtol=0, atol=1e-6)
    winding = winding_numbers(points.double().numpy(), triangles)
    clear = np.abs(winding - 0.5) > 0.05
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(distance.numpy()[clear] < 0, winding[clear] > 0.5)


def test_a_closed_mesh() -> None:
    vertices, faces = sphere()
    check(vertices, faces, points_about(0.1), MeshDistance(vertices, faces))


def test_a_mesh_that_is_open_below_and_has_parts_inside() -> None:
    """What a tracked head is like: open at the bottom, with closed surfaces within."""
    vertices, faces = sphere()
    faces = faces[vertices[faces].mean(dim=1)[:, 1] > -0.08]
    inner, inner_faces = sphere(radius=0.02, rings=8, sides=10)
    faces = torch.cat([faces, inner_faces + len(vertices)])
    vertices = torch.cat([vertices, inner + torch.tensor([0.0, 0.0, 0.07])])
    points = torch.cat([points_about(0.1), points_about(0.02, 100) + torch.tensor([0.0, 0.0, 0.07])])
    check(vertices, faces, points, MeshDistance(vertices, faces))


def test_the_nearest_face_holds_the_nearest_point() -> None:
    vertices, faces = sphere()
    points = points_about(0.1)
    found = MeshDistance(vertices, faces).nearest(points)
    each = [distances_to_triangles(points.double().numpy(), tri[None]) for tri in vertices[faces].double().numpy()]
    np.testing.assert_allclose(
        np.stack(each)[found.face.numpy(), np.arange(len(points))], np.stack(each).min(0), atol=1e-6
    )
    on_face = vertices[faces[found.face.long()]].double().numpy()
    for place, triangle in zip(found.position.double().numpy(), on_face, strict=True):
        assert distances_to_triangles(place[None], triangle[None])[0] < 1e-6


def test_several_threads_find_what_one_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, points = MeshDistance(*sphere()), points_about(0.1, 1001)
    alone = mesh.nearest(points)
    monkeypatch.setattr("dynhair.threads.thread_count", lambda: 3)
    for one, several in zip(alone, mesh.nearest(points), strict=True):
        assert torch.equal(one, several)
    assert mesh.nearest(points[:0]).face.shape == (0,)
    assert len(mesh.nearest(points[:2]).face) == 2


def test_refitting_moves_the_mesh_and_not_the_callers_vertices() -> None:
    vertices, faces = sphere()
    original = vertices.clone()
    mesh = MeshDistance(vertices, faces)
    moved = vertices * 1.5 + torch.tensor([0.3, 0.0, -0.1])
    mesh.refit(moved)
    check(moved, faces, points_about(0.15) + torch.tensor([0.3, 0.0, -0.1]), mesh)
    assert torch.equal(vertices, original)


def test_distances_carry_no_gradient_and_take_any_points() -> None:
    mesh = MeshDistance(*sphere())
    distance, closest = mesh.query(points_about(0.1, 5).double().requires_grad_())
    assert not distance.requires_grad
    assert not closest.requires_grad
    assert mesh.query(torch.zeros(0, 3))[0].shape == (0,)
    assert mesh.query(torch.zeros(3, 5).T)[0].max() < -0.09
    far, _ = mesh.query(torch.tensor([[1000.0, 0.0, 0.0]]))
    assert far.item() == pytest.approx(999.9, abs=1e-3)


def test_points_that_are_not_finite_have_no_distance() -> None:
    found = MeshDistance(*sphere()).nearest(torch.tensor([[torch.nan, 0, 0], [0, torch.inf, 0], [0, 0, 0]]))
    assert found.distance.isnan().tolist() == [True, True, False]
    assert found.face[:2].tolist() == [-1, -1]
    assert found.face[2] >= 0


def test_threads_have_their_own_meshes_and_may_share_one() -> None:
    vertices, faces = sphere()
    points = points_about(0.1, 2000)
    shared = MeshDistance(vertices, faces)
    expected, _ = shared.query(points)
    failures: list[str] = []

    def work(factor: float) -> None:
        own = MeshDistance(vertices * factor, faces)
        for _ in range(5):
            if not torch.equal(shared.query(points)[0], expected):
                failures.append("shared")
            if not torch.allclose(own.query(points * factor)[0], expected * factor, atol=1e-6):
                failures.append("own")

    threads = [threading.Thread(target=work, args=(factor,)) for factor in (0.5, 2.0, 3.0)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures


class Ball:
    """An obstacle with exact distances."""

    def query(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        length = points.norm(dim=1, keepdim=True).clamp_min(1e-9)
        return length[:, 0] - 0.09, points / length * 0.09


@pytest.mark.parametrize("clearance", [0.0, 0.01])
def test_points_are_pushed_straight_out(clearance: float) -> None:
    points = torch.tensor([[0.05, 0, 0], [0, -0.089, 0], [0, 0, 0.2]])
    expected = torch.tensor([[0.09 + clearance, 0, 0], [0, -0.09 - clearance, 0], [0, 0, 0.2]])
    torch.testing.assert_close(push_out(points, Ball(), clearance), expected, atol=1e-6, rtol=0)
