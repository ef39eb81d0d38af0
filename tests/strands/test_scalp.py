"""Roots on a scalp and their neighbours."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from meshes import sphere
from scipy.spatial import KDTree

from dynhair.errors import DynhairError
from dynhair.strands import root_neighbours, sample_roots


def scalp() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A sphere with hair on its upper half."""
    vertices, faces = sphere()
    upper = (vertices[faces].mean(dim=1)[:, 1] > 0).nonzero().squeeze(1)
    return vertices, faces, upper


def test_each_face_has_its_share_of_roots() -> None:
    vertices, faces, upper = scalp()
    roots = sample_roots(vertices, faces, upper, 5000, seed=3)
    counts = torch.bincount(roots.face, minlength=len(faces))
    assert counts.sum() == 5000
    assert counts[upper].sum() == 5000
    a, b, c = vertices[faces[upper]].unbind(dim=1)
    areas = torch.linalg.cross(b - a, c - a).norm(dim=1)
    assert (counts[upper] - 5000 * areas / areas.sum()).abs().max() < 2


def test_roots_are_uniform_within_a_face() -> None:
    """Mean and second moments of uniform barycentric weights are 1/3, 1/6 (same) and 1/12 (mixed)."""
    vertices, faces = torch.eye(3), torch.tensor([[0, 1, 2]])
    weights = sample_roots(vertices, faces, torch.tensor([0]), 20_000, seed=0).barycentric
    assert weights.min() >= 0
    torch.testing.assert_close(weights.sum(dim=1), torch.ones(20_000))
    torch.testing.assert_close(weights.mean(dim=0), torch.full((3,), 1 / 3), rtol=0, atol=0.01)
    moments = weights.T @ weights / 20_000
    torch.testing.assert_close(moments, torch.full((3, 3), 1 / 12) + torch.eye(3) / 12, rtol=0, atol=0.01)


def test_a_seed_always_gives_the_same_roots() -> None:
    first, again, other = (sample_roots(*scalp(), 50, seed=seed) for seed in (7, 7, 8))
    assert torch.equal(first.face, again.face)
    assert torch.equal(first.barycentric, again.barycentric)
    assert not torch.equal(first.barycentric, other.barycentric)
    assert first.face[:4].tolist() == [1349, 1430, 1170, 66]  # on every platform


def test_any_leading_part_covers_the_scalp() -> None:
    vertices, faces, upper = scalp()
    some = sample_roots(vertices, faces, upper, 4000, seed=0).positions(vertices)[:400]
    assert (some.mean(dim=0)[[0, 2]].abs() < 0.01).all()


def test_roots_follow_the_mesh() -> None:
    vertices, faces, upper = scalp()
    roots = sample_roots(vertices, faces, upper, 100, seed=0)
    shift = torch.tensor([1.0, 2.0, 3.0])
    torch.testing.assert_close(roots.positions(2 * vertices + shift), 2 * roots.positions(vertices) + shift)
    outwards = torch.nn.functional.normalize(roots.positions(vertices), dim=-1)
    assert ((roots.normals(vertices) * outwards).sum(dim=1) > 0.98).all()
    assert (roots.positions(vertices).norm(dim=1) - 0.1).abs().max() < 1e-3


def test_a_scalp_without_faces_is_refused() -> None:
    vertices, faces, _ = scalp()
    with pytest.raises(DynhairError, match="no area"):
        sample_roots(vertices, faces, torch.zeros(0, dtype=torch.long), 10, seed=0)


def test_neighbours_agree_with_scipy() -> None:
    roots = torch.randn(300, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    _, expected = KDTree(roots.numpy()).query(roots.numpy(), k=6)
    assert root_neighbours(roots, 5).tolist() == np.asarray(expected)[:, 1:].tolist()


def test_roots_on_the_same_spot_are_neighbours_but_never_their_own() -> None:
    roots = torch.zeros(9, 3)
    neighbours = root_neighbours(roots, 4)
    assert neighbours.shape == (9, 4)
    assert (neighbours != torch.arange(9)[:, None]).all()


@pytest.mark.parametrize("k", [0, 5])
def test_impossible_numbers_of_neighbours_are_refused(k: int) -> None:
    with pytest.raises(DynhairError, match=f"{k} neighbours among 5"):
        root_neighbours(torch.randn(5, 3), k)
