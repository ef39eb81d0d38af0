"""The scalp's sphere, its flat texture, and the roots of its texels."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from meshes import sphere
from scipy.optimize import least_squares

from dynhair.errors import DynhairError
from dynhair.face import open_head
from dynhair.strands import Roots, ScalpFrame, directions, sample_roots, smooth_surface, texel_uv, texture_roots

UNIT = ScalpFrame(centre=torch.zeros(3, dtype=torch.float64), radius=1.0)


def cap(shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A sphere of 0.1 m with hair above and behind."""
    vertices, faces = sphere()
    middle = vertices[faces].mean(dim=1)
    scalp = (middle[:, 1] - 0.6 * middle[:, 2] > -0.02).nonzero().squeeze(1)
    return vertices + torch.tensor(shift), faces, scalp


def test_a_sphere_is_found_from_its_cap() -> None:
    frame = ScalpFrame.of(*cap((0.3, -0.2, 0.1)))
    torch.testing.assert_close(frame.centre, torch.tensor([0.3, -0.2, 0.1]), atol=1e-3, rtol=0)
    assert frame.radius == pytest.approx(0.1, abs=1e-3)


def test_the_fit_is_least_squares_weighted_by_area() -> None:
    """Against SciPy on many points drawn uniformly by area from a scalp that is no sphere."""
    vertices, faces, scalp = cap()
    vertices = vertices * torch.tensor([0.8, 1.1, 1.0])
    points = sample_roots(vertices, faces, scalp, 20_000, seed=0).positions(vertices).double().numpy()

    def algebraic(x: np.ndarray) -> np.ndarray:
        return ((points - x[:3]) ** 2).sum(axis=1) - x[3] ** 2

    expected = least_squares(algebraic, [0, 0, 0, 0.1], x_scale=0.01, xtol=1e-12, ftol=1e-12, gtol=1e-14).x
    frame = ScalpFrame.of(vertices, faces, scalp)
    np.testing.assert_allclose(frame.centre.numpy(), expected[:3], atol=1e-4)
    assert frame.radius == pytest.approx(expected[3], abs=1e-4)


def test_scalp_units_and_back() -> None:
    frame = ScalpFrame(centre=torch.tensor([0.1, 0.2, 0.3]), radius=0.09)
    points = torch.randn(5, 4, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(frame.to_head(frame.to_scalp(points)), points)
    torch.testing.assert_close(frame.to_scalp(torch.tensor([0.1, 0.29, 0.3])), torch.tensor([0.0, 1.0, 0.0]))


@given(st.floats(0, 0.999), st.floats(0, 2 * math.pi))
def test_texture_and_directions_are_each_others_inverse(radius: float, angle: float) -> None:
    uv = torch.tensor([[radius * math.cos(angle), radius * math.sin(angle)]], dtype=torch.float64) / 2 + 0.5
    direction = directions(uv)
    torch.testing.assert_close(direction.norm(dim=-1), torch.ones(1, dtype=torch.float64))
    torch.testing.assert_close(UNIT.uv(direction), uv, atol=1e-9, rtol=0)


@given(st.tuples(*[st.floats(-1, 1)] * 3))
def test_every_point_has_a_place_on_the_texture(point: tuple[float, float, float]) -> None:
    for dtype in (torch.float32, torch.float64):
        uv = UNIT.uv(torch.tensor([point], dtype=dtype))
        assert uv.isfinite().all()
        assert uv.min() >= 0
        assert uv.max() <= 1


def test_points_beyond_the_rim_are_drawn_in_to_it() -> None:
    tilt = math.radians(30)
    opposite = torch.tensor([[0, -math.cos(tilt), math.sin(tilt)]], dtype=torch.float64)
    assert (UNIT.uv(opposite) - 0.5).norm().item() == pytest.approx(0.5, abs=1e-6)
    corner = directions(torch.tensor([[0.0, 0.0]], dtype=torch.float64))
    rim = directions(torch.tensor([[0.5 - 0.5 / math.sqrt(2)] * 2], dtype=torch.float64))
    torch.testing.assert_close(corner, rim)


def test_the_texture_lies_as_a_head_seen_from_the_crown() -> None:
    crown, left, face = UNIT.uv(torch.tensor([[0, 0.866025, -0.5], [1, 0.5, 0], [0, 0.2, 1]], dtype=torch.float64))
    torch.testing.assert_close(crown, torch.tensor([0.5, 0.5], dtype=torch.float64), atol=1e-5, rtol=0)
    assert left[0] > 0.6
    assert face[0] == 0.5
    assert face[1] > 0.8


def test_texels_have_equal_areas() -> None:
    """Any patch of the sphere holds the texels that its area entitles it to: 4 / (pi sin^2(rim / 2)) parts of 4 pi."""
    size = 128
    inside = (2 * texel_uv(size) - 1).norm(dim=-1) < 1
    rays = directions(texel_uv(size)[inside])
    generator = torch.Generator().manual_seed(0)
    for axis in torch.randn(6, 3, generator=generator, dtype=torch.float64):
        direction = torch.nn.functional.normalize(axis.abs() * torch.tensor([1, 1, -1]), dim=0)
        polar = math.radians(25)
        expected = math.pi * size**2 / 4 * math.sin(polar / 2) ** 2 / math.sin(math.radians(62.5)) ** 2
        assert int((rays @ direction > math.cos(polar)).sum()) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_texture_roots_lie_under_their_texels(dtype: torch.dtype) -> None:
    vertices, faces, scalp = cap((0.3, -0.2, 0.1))
    vertices = vertices.to(dtype)
    frame = ScalpFrame.of(vertices, faces, scalp)
    roots, texels = texture_roots(vertices, faces, scalp, frame, 24)
    assert torch.equal(roots.triangle, faces[roots.face])
    assert torch.isin(roots.face, scalp).all()
    assert (roots.barycentric >= 0).all()
    assert (texels.diff() > 0).all()
    uv = frame.uv(roots.positions(vertices))
    torch.testing.assert_close(uv, texel_uv(24)[texels].to(uv), atol=2e-6, rtol=0)


def test_texels_are_valid_exactly_where_the_scalp_is() -> None:
    """A ray meets the scalp if the point of the sphere's mesh in its direction lies on a scalp face."""
    vertices, faces, scalp = cap()
    frame = ScalpFrame(centre=torch.zeros(3), radius=0.1)
    everywhere, texels = texture_roots(vertices, faces, torch.arange(len(faces)), frame, 32)
    assert torch.equal(texels, ((2 * texel_uv(32) - 1).norm(dim=-1) <= 1).nonzero().squeeze(1))
    _, valid = texture_roots(vertices, faces, scalp, frame, 32)
    on_scalp = torch.isin(everywhere.face, scalp)
    assert torch.equal(valid, texels[on_scalp])


def test_the_outermost_hit_counts() -> None:
    vertices, faces = sphere()
    both, doubled = torch.cat([0.5 * vertices, vertices]), torch.cat([faces, faces + len(vertices)])
    frame = ScalpFrame(centre=torch.zeros(3), radius=0.1)
    roots, _ = texture_roots(both, doubled, torch.arange(len(doubled)), frame, 16)
    assert (roots.face >= len(faces)).all()


def test_the_open_heads_scalp_fits_the_disc_with_room_to_spare() -> None:
    head = open_head()
    frame = ScalpFrame.of(head.mean, head.faces, head.scalp)
    corners = head.mean[head.faces[head.scalp]].flatten(0, 1)
    assert (frame.uv(corners) - 0.5).norm(dim=-1).max() < 0.47
    _, texels = texture_roots(head.mean, head.faces, head.scalp, frame, 32)
    assert len(texels) > 500


@pytest.mark.parametrize("broken", ["empty", "flat", "point"])
def test_scalps_without_a_sphere_are_refused(broken: str) -> None:
    vertices, faces, scalp = cap()
    vertices = {"empty": vertices, "flat": vertices * torch.tensor([1, 0, 1]), "point": 0 * vertices}[broken]
    with pytest.raises(DynhairError, match="no sphere fits"):
        ScalpFrame.of(vertices, faces, scalp[:0] if broken == "empty" else scalp)


def test_a_scalp_that_no_texel_meets_is_refused() -> None:
    vertices, faces, scalp = cap()
    with pytest.raises(DynhairError, match="no texel"):
        texture_roots(vertices, faces, scalp, ScalpFrame(centre=torch.tensor([0.0, -1, 0.9]), radius=0.01), 8)


def test_a_coarse_sphere_is_made_round() -> None:
    vertices, faces = (x.double() if x.is_floating_point() else x for x in sphere(rings=12, sides=16))
    roots = sample_roots(vertices, faces, torch.arange(len(faces)), 2000, seed=0)
    positions, normals = smooth_surface(roots, vertices, faces)
    flatness = (roots.positions(vertices).norm(dim=-1) - 0.1).abs().max()
    assert (positions.norm(dim=-1) - 0.1).abs().max() < flatness / 8
    outwards = torch.nn.functional.normalize(positions, dim=-1)
    assert (normals * outwards).sum(dim=-1).min() > math.cos(math.radians(3))
    assert (roots.normals(vertices) * outwards).sum(dim=-1).min() < math.cos(math.radians(8))


def test_roundness_keeps_corners_and_planes_and_follows_the_mesh() -> None:
    vertices, faces, scalp = cap()
    corner = Roots(scalp[:9], faces[scalp[:9]], torch.eye(3)[:1].expand(9, 3))
    positions, _ = smooth_surface(corner, vertices, faces)
    torch.testing.assert_close(positions, vertices[faces[scalp[:9], 0]])
    flat = torch.tensor([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]])
    quad = torch.tensor([[0, 1, 2], [1, 3, 2]])
    roots = sample_roots(flat, quad, torch.arange(2), 50, seed=0)
    positions, normals = smooth_surface(roots, flat, quad)
    torch.testing.assert_close(positions, roots.positions(flat))
    torch.testing.assert_close(normals, torch.tensor([[0.0, 1, 0]]).expand(50, 3))
    moved = vertices.double().requires_grad_()
    some = sample_roots(vertices, faces, scalp, 3, seed=0)
    assert torch.autograd.gradcheck(lambda v: smooth_surface(some, v, faces), moved, fast_mode=True)
