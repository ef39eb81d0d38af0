"""Samples of hair: equal counts, the same hair in every frame, and which Gaussians count as hair."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.evaluation.hair_samples import POINTS, STRANDS, PointSample, StrandSample, hair_gaussians
from dynhair.strands import resample_strands

SIZE = 8


def strands(count: int, points: int = 20) -> Tensor:
    generator = torch.Generator().manual_seed(count)
    return torch.randn(count, points, 3, generator=generator).cumsum(dim=1)


def camera(direction: Tensor) -> Camera:
    """From 4 m away on one side, towards the origin; the image spans 2 m there."""
    forward = -direction
    right = torch.linalg.cross(forward, torch.tensor([0.0, 1.0, 0.0]))
    rotation = torch.stack([right, torch.linalg.cross(forward, right), forward])
    K = torch.tensor([[4.0 * SIZE / 2, 0.0, SIZE / 2], [0.0, 4.0 * SIZE / 2, SIZE / 2], [0.0, 0.0, 1.0]])
    return Camera(torch.cat([rotation, -(rotation @ (4.0 * direction))[:, None]], dim=1), K, SIZE, SIZE)


FRONT, RIGHT, BACK = (camera(torch.tensor(d)) for d in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]))


@given(st.integers(1, 3 * STRANDS))
def test_whole_strands_once_each(available: int) -> None:
    hair = strands(available)
    sample = StrandSample(available)(hair)
    assert sample.shape == (min(available, STRANDS), POINTS, 3)
    every = resample_strands(hair.double(), POINTS)
    matches = (sample[:, None] == every[None]).all(dim=(2, 3))
    assert (matches.sum(dim=1) == 1).all()
    assert (matches.sum(dim=0) <= 1).all()


def test_the_same_strands_in_every_frame() -> None:
    hair, shift = strands(300), torch.tensor([0.1, -0.2, 0.3])
    first, second = StrandSample(300), StrandSample(300)
    torch.testing.assert_close(second(hair + shift), first(hair) + shift.double(), atol=1e-5, rtol=0)


def test_as_many_strands_as_the_sparser_hair_has() -> None:
    assert StrandSample(300, 7)(strands(300)).shape == (7, POINTS, 3)


def test_strands_of_few_points_keep_their_shape() -> None:
    straight = torch.tensor([[[0.0, 0.0, 0.0], [0.0, -0.31, 0.0]]])
    sample = StrandSample(1)(straight)[0]
    torch.testing.assert_close(sample[:, 1], -0.01 * torch.arange(POINTS).double(), atol=1e-8, rtol=0)


def test_points_come_from_the_hair() -> None:
    points = torch.arange(30.0).reshape(10, 3)
    hair = torch.tensor([1, 4, 5, 9])
    sample = PointSample(hair, 3)
    chosen = sample(points)
    assert chosen.shape == (3, 3)
    assert {row[0] for row in chosen.tolist()} < {points[i, 0].item() for i in hair.tolist()}
    torch.testing.assert_close(sample(points + 1), chosen + 1)
    torch.testing.assert_close(PointSample(hair, 100)(points), points[hair].double())


def test_hair_is_where_most_cameras_see_it() -> None:
    left, right = torch.tensor([-0.5, 0.0, 0.0]), torch.tensor([0.5, 0.0, 0.0])
    means = torch.stack([left, right])
    halves = torch.zeros(2, SIZE, SIZE, dtype=torch.bool)
    halves[0, :, SIZE // 2 :] = True  # the front sees +x on its right
    halves[1, :, : SIZE // 2] = True  # the back on its left
    assert hair_gaussians(means, halves, [FRONT, BACK]).tolist() == [1]
    assert hair_gaussians(means, halves[:1].expand(2, -1, -1), [FRONT, BACK]).tolist() == []  # half is not most
    everywhere = torch.cat([halves, torch.ones(1, SIZE, SIZE, dtype=torch.bool)])
    assert hair_gaussians(means, everywhere, [FRONT, BACK, RIGHT]).tolist() == [1]


def test_cameras_that_do_not_see_a_gaussian_have_no_say() -> None:
    far_left, behind_front = torch.tensor([-2.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, 5.0])
    means = torch.stack([far_left, behind_front])
    hair = torch.ones(2, SIZE, SIZE, dtype=torch.bool)
    assert hair_gaussians(means, hair[:1], [FRONT]).tolist() == []
    assert hair_gaussians(means, hair, [FRONT, RIGHT]).tolist() == [0]
    assert hair_gaussians(means, hair, [FRONT, BACK]).tolist() == [1]


def test_no_hair_and_too_few_cameras() -> None:
    nothing = torch.zeros(2, SIZE, SIZE, dtype=torch.bool)
    assert hair_gaussians(torch.zeros(3, 3), nothing, [FRONT, BACK]).tolist() == []
    with pytest.raises(DynhairError, match="2 silhouettes"):
        hair_gaussians(torch.zeros(3, 3), nothing, [FRONT])
