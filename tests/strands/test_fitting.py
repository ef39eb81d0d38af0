"""Grooms in any unit, axes and place are brought back onto the head that they were made for."""

from __future__ import annotations

import functools

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.face import open_head
from dynhair.hairstyles import HeadField, grow_hairstyle, random_style
from dynhair.strands import MeshDistance, sample_roots
from dynhair.strands.fitting import FittedStrands, fit_to_scalp
from dynhair.strands.scalp_map import ScalpFrame
from dynhair.strands.similarity import Similarities, closest_similarities

HEAD = open_head()
FAMILIES = ("long_layered_side", "ponytail_high", "coily_volume", "cropped")
UP, LEFT, OUT = torch.eye(3, dtype=torch.float64)[[1, 0, 2]]


@functools.cache
def field() -> HeadField:
    return HeadField.of(HEAD.mean, HEAD.faces)


@functools.cache
def groom(family: str) -> torch.Tensor:
    roots = sample_roots(HEAD.mean, HEAD.faces, HEAD.scalp, 400, seed=5)
    frame = ScalpFrame.of(HEAD.mean, HEAD.faces, HEAD.scalp)
    positions, normals = roots.positions(HEAD.mean), roots.normals(HEAD.mean)
    return grow_hairstyle(random_style(family, seed=3), positions, normals, frame, field(), points=16)


def fitted(strands: torch.Tensor) -> FittedStrands:
    return fit_to_scalp(strands, HEAD.mean, HEAD.faces, HEAD.scalp)


def turned(axis: torch.Tensor, degrees: float) -> torch.Tensor:
    x, y, z = (torch.deg2rad(torch.tensor(degrees, dtype=torch.float64)) * axis).tolist()
    return torch.linalg.matrix_exp(torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64))


def disguised(strands: torch.Tensor, rotation: torch.Tensor, scale: float, shift: torch.Tensor) -> torch.Tensor:
    return scale * (strands.double() @ rotation.T + shift)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_groom_on_the_scalp_stays_there(family: str) -> None:
    strands = groom(family) + torch.tensor([0.0, 0.001, 0.0])
    found = fitted(strands)
    assert not found.flipped
    assert found.scale == 1
    assert found.kept.tolist() == list(range(len(strands)))
    torch.testing.assert_close(found.rotation, torch.eye(3))
    distances, _ = MeshDistance(HEAD.mean, HEAD.faces[HEAD.scalp]).query(found.strands[:, 0])
    assert distances.abs().max() < 1e-6
    torch.testing.assert_close(found.strands.diff(dim=1), strands.diff(dim=1), atol=1e-6, rtol=0)
    assert (found.strands - strands).norm(dim=-1).max() < 0.0011


@pytest.mark.parametrize("family", FAMILIES)
def test_a_groom_on_the_scalp_with_tips_first_is_turned_round(family: str) -> None:
    found = fitted(groom(family).flip(1))
    assert found.flipped
    torch.testing.assert_close(found.strands, groom(family), atol=1e-5, rtol=0)


@given(
    family=st.sampled_from(FAMILIES),
    up=st.sampled_from([UP, -UP, OUT, -OUT, LEFT, -LEFT]),
    quarter=st.integers(0, 3),
    exponent=st.floats(-3, 4),
    shift=st.tuples(*[st.floats(-3, 3)] * 3),
    is_tip_first=st.booleans(),
)
@settings(max_examples=8)
def test_unit_axes_and_place_are_found(
    family: str, up: torch.Tensor, quarter: int, exponent: float, shift: tuple[float, ...], is_tip_first: bool
) -> None:
    side = torch.linalg.cross(up, up.roll(1))
    rotation = turned(up, 90 * quarter) @ torch.stack([side, up, torch.linalg.cross(side, up)], dim=1)
    strands = disguised(groom(family), rotation, 10**exponent, torch.tensor(shift, dtype=torch.float64))
    found = fitted(strands.flip(1) if is_tip_first else strands)
    assert found.flipped == is_tip_first
    torch.testing.assert_close(found.rotation, rotation.T, atol=1e-9, rtol=0)
    assert found.scale * 10**exponent == pytest.approx(1, abs=0.02)
    assert found.residual < 2e-3
    error = (found.strands - groom(family)).norm(dim=-1)
    assert error[:, 0].mean() < 3e-3
    assert error.mean() < 6e-3


@pytest.mark.parametrize("degrees", [-25.0, 25.0])
def test_axes_askew_are_found_nearly(degrees: float) -> None:
    rotation = turned(torch.nn.functional.normalize(UP + LEFT + OUT, dim=0), degrees)
    found = fitted(disguised(groom(FAMILIES[0]), rotation, 100, 0.3 * UP))
    assert torch.linalg.det(found.rotation) == pytest.approx(1)
    left_over = torch.arccos((torch.trace(found.rotation @ rotation) - 1) / 2).rad2deg()
    assert left_over < 13
    assert found.residual < 2e-3


def test_a_tiny_groom_beside_the_scalp_is_not_taken_to_be_on_it() -> None:
    beside = HEAD.mean[HEAD.faces[HEAD.scalp[0], 0]].double()
    found = fitted(disguised(groom(FAMILIES[0]), torch.eye(3, dtype=torch.float64), 0.01, 100 * beside))
    assert found.scale == pytest.approx(100, rel=0.02)


def test_a_lock_on_the_scalp_stays_there() -> None:
    strands = groom(FAMILIES[0])
    lock = strands[(strands[:, 0] - strands[0, 0]).norm(dim=-1) < 0.03]
    assert fitted(lock).scale == 1


def test_one_strand_elsewhere_is_refused() -> None:
    with pytest.raises(DynhairError, match="all start and all end at one place"):
        fitted(groom(FAMILIES[0])[:1] + 1)


def test_a_scalp_that_is_bare_below_is_recognised() -> None:
    strands = groom("ponytail_high")
    upper = strands[strands[:, 0, 1] > strands[:, 0, 1].quantile(0.3)]
    found = fitted(disguised(upper, turned(LEFT, 90), 100, OUT))
    assert found.scale * 100 == pytest.approx(1, abs=0.05)
    torch.testing.assert_close(found.rotation, turned(LEFT, -90), atol=1e-9, rtol=0)


def test_another_head_takes_the_groom_over() -> None:
    identity = torch.zeros(len(HEAD.identity_modes))
    identity[:4] = torch.tensor([1.0, -1.0, 0.5, 1.0])
    vertices = HEAD.vertices(identity)
    given_strands = disguised(groom(FAMILIES[0]), turned(LEFT, 90), 39.37, UP)
    found = fit_to_scalp(given_strands, vertices, HEAD.faces, HEAD.scalp)
    torch.testing.assert_close(found.rotation, turned(LEFT, -90), atol=1e-9, rtol=0)
    distances, _ = MeshDistance(vertices, HEAD.faces[HEAD.scalp]).query(found.strands[:, 0].float())
    assert distances.abs().max() < 1e-6
    assert (found.strands[:, -1, 1] < found.strands[:, 0, 1] - 0.1).double().mean() > 0.9


def test_strands_that_are_no_hair_of_the_head_are_left_out() -> None:
    chin = HEAD.mean[HEAD.landmarks68[8]] + 0.01 * torch.randn(40, 1, 3, generator=torch.Generator().manual_seed(0))
    beard = chin - torch.linspace(0, 0.03, 16)[:, None] * torch.tensor([0.0, 1.0, 0.0])
    strands = torch.cat([beard, groom(FAMILIES[0])])
    for found in (fitted(strands), fitted(disguised(strands, turned(LEFT, 90), 100, OUT))):
        assert found.kept.tolist() == list(range(40, len(strands)))
        assert (found.strands - groom(FAMILIES[0])).norm(dim=-1).mean() < 0.01


@pytest.mark.parametrize(
    ("spread", "found"), [([0.3, 0.3, 0.3], "mm off"), ([1.0, 1.0, 0.0], "of it bare"), ([1.0, 0.0, 0.0], "of it bare")]
)
def test_roots_that_lie_on_no_scalp_are_refused(spread: list[float], found: str) -> None:
    random = torch.Generator().manual_seed(0)
    roots = torch.tensor(spread) * torch.rand(300, 1, 3, generator=random)
    strands = roots + 0.1 * torch.randn(300, 8, 3, generator=random).cumsum(dim=1)
    with pytest.raises(DynhairError, match=f"do not lie on a scalp of this shape: .*{found}"):
        fitted(strands)


def test_strands_from_one_point_are_refused() -> None:
    with pytest.raises(DynhairError, match="all start and all end at one place"):
        fitted(torch.tensor([1.0, 2, 3]).expand(50, 4, 3))


def test_tips_that_are_tied_together_are_no_roots() -> None:
    strands = groom("ponytail_high").clone()
    strands[:, -1] = strands[0, -1]
    assert not fitted(disguised(strands, turned(UP, 90), 7, OUT)).flipped


@pytest.mark.parametrize("strands", [torch.zeros(0, 5, 3), torch.zeros(5, 1, 3), torch.full((5, 5, 3), torch.nan)])
def test_what_is_no_strand_is_refused(strands: torch.Tensor) -> None:
    with pytest.raises(DynhairError, match="cannot be placed on a head"):
        fitted(strands)


@given(seed=st.integers(0, 2**31))
def test_closest_similarities_find_the_one_that_was_applied(seed: int) -> None:
    random = torch.Generator().manual_seed(seed)
    points = torch.randn(2, 9, 3, generator=random, dtype=torch.float64)
    axes = torch.linalg.qr(torch.randn(2, 3, 3, generator=random, dtype=torch.float64))[0]
    rotation = axes * torch.linalg.det(axes)[:, None, None]
    applied = Similarities(torch.rand(2, generator=random).double() + 0.1, rotation, torch.randn(2, 3).double())
    weights = torch.rand(2, 9, generator=random).double() + 0.01
    for kept in (None, rotation):
        found = closest_similarities(points, applied.apply(points), weights, kept)
        torch.testing.assert_close(found.apply(points), applied.apply(points))
        torch.testing.assert_close(found.rotation, rotation)


def test_closest_similarities_never_mirror_and_mind_weights() -> None:
    points = torch.randn(1, 20, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    mirrored = points * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    found = closest_similarities(points, mirrored, torch.ones(1, 20, dtype=torch.float64))
    assert torch.linalg.det(found.rotation) == pytest.approx(1)
    outlying = points.clone()
    outlying[0, 0] += 100
    weights = torch.ones(1, 20, dtype=torch.float64)
    weights[0, 0] = 0
    torch.testing.assert_close(closest_similarities(points, outlying, weights).apply(points), points)
