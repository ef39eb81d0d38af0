"""Strands inside a ball, and strands that stretch, in closed form."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.evaluation.strand_contact import Penetration, Stretch
from dynhair.strands import MeshDistance

RADIUS = 0.1


@cache
def ball() -> MeshDistance:
    """A polyhedron of 2,000 corners, as good as round."""
    turns = np.arange(2000) * np.pi * (3 - math.sqrt(5))
    height = np.linspace(-1, 1, 2000)
    ring = np.sqrt(1 - height**2)
    points = RADIUS * np.stack([ring * np.cos(turns), height, ring * np.sin(turns)], axis=1)
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    inwards = np.einsum(
        "fc,fc->f", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]
    )
    faces = np.where((inwards < 0)[:, None], hull.simplices[:, ::-1], hull.simplices)
    return MeshDistance(torch.from_numpy(points).float(), torch.from_numpy(faces.astype(np.int64)))


def ray(radii: list[float]) -> Tensor:
    """One strand along a slanted ray from the ball's centre."""
    return torch.tensor(radii)[None, :, None] * torch.tensor([0.6, 0.48, 0.64])


def strands(seed: int) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).normal(0.0, 0.02, (6, 5, 3)).cumsum(axis=1))


def test_share_and_depth_of_points_in_a_ball() -> None:
    penetration = Penetration()
    penetration.add(ray([0.0, 0.05, 0.08, 0.12, 0.15]), ball())  # the root is left out
    figures = penetration.figures()
    assert figures.rate == pytest.approx(0.5)
    assert figures.depth_mm == pytest.approx(35.0, abs=0.3)
    penetration.add(ray([0.1, 0.2, 0.2, 0.2, 0.2]), ball())
    assert penetration.figures().rate == pytest.approx(0.25)
    assert penetration.figures().depth_mm == pytest.approx(35.0, abs=0.3)


@given(st.integers(0, 1000))
def test_equals_the_distance_from_the_centre(seed: int) -> None:
    hair = strands(seed).float() * 3
    radii = hair[:, 1:].norm(dim=-1).flatten()
    if ((radii - RADIUS).abs() < 5e-4).any():
        return
    penetration = Penetration()
    penetration.add(hair, ball())
    inside = radii < RADIUS
    figures = penetration.figures()
    assert figures.rate == pytest.approx(inside.double().mean().item())
    if inside.any():
        assert figures.depth_mm == pytest.approx(1e3 * (RADIUS - radii[inside]).mean().item(), abs=0.5)


def test_parts_of_a_motion_together() -> None:
    one, two, both = Penetration(), Penetration(), Penetration()
    for seed in range(4):
        (one if seed < 2 else two).add(strands(seed).float() * 3, ball())
        both.add(strands(seed).float() * 3, ball())
    one.merge(two)
    assert one.figures() == pytest.approx(both.figures())


def test_no_points_and_none_inside() -> None:
    penetration = Penetration()
    assert all(math.isnan(value) for value in penetration.figures())
    penetration.add(ray([0.1, 0.2]), ball())
    assert penetration.figures().rate == 0.0
    assert math.isnan(penetration.figures().depth_mm)


@given(st.floats(0.5, 2.0), st.integers(0, 1000))
def test_an_even_stretch_is_its_share_in_any_pose(factor: float, seed: int) -> None:
    rest = strands(seed)
    turn = torch.from_numpy(Rotation.random(rng=np.random.default_rng(seed)).as_matrix())
    stretch = Stretch(rest)
    stretch.add(factor * rest @ turn.T + 0.3)
    assert stretch.rms() == pytest.approx(abs(factor - 1), abs=1e-9)


def test_frames_and_parts_count_by_their_squares() -> None:
    rest = strands(0)
    stretch, other, whole = Stretch(rest), Stretch(rest), Stretch(rest)
    for meter, factor in ((stretch, 1.0), (stretch, 1.1), (other, 0.8)):
        meter.add(factor * rest)
        whole.add(factor * rest)
    stretch.merge(other)
    assert stretch.rms() == pytest.approx(math.sqrt((0.1**2 + 0.2**2) / 3))
    assert stretch.rms() == pytest.approx(whole.rms())


def test_a_tiny_segment_does_not_govern() -> None:
    rest = torch.tensor([[[0.0, 0.0, 0.0], [0.0, 1e-5, 0.0], [0.0, 0.1, 0.0]]]).double()
    grown = rest.clone()
    grown[0, 1, 1] = 1e-4
    stretch = Stretch(rest)
    stretch.add(grown)
    assert stretch.rms() == pytest.approx(math.sqrt(2) * 9e-5 / 0.1, rel=1e-3)


def test_no_frames_and_bad_strands() -> None:
    assert math.isnan(Stretch(strands(0)).rms())
    with pytest.raises(DynhairError, match="no length"):
        Stretch(torch.zeros(3, 4, 3))
    with pytest.raises(DynhairError, match="3 strands of 5 points"):
        Stretch(strands(0)).add(strands(0)[:3])
