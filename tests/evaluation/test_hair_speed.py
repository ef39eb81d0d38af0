"""Velocity and acceleration of clouds of hair points, against closed forms and all pairs of points."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.evaluation.hair_speed import HairSpeed, HairSpeedFigures

FPS = 30.0


def lattice() -> Tensor:
    """Points 0.1 m apart: each stays its own nearest neighbour when all move by less than half of that."""
    axis = 0.1 * torch.arange(4).double()
    return torch.cartesian_prod(axis, axis, axis)


def speed(frames: list[Tensor], fps: float = FPS) -> HairSpeedFigures:
    meter = HairSpeed(fps)
    for frame in frames:
        meter.add(frame)
    return meter.figures()


def cloud(seed: int, frames: int = 5, points: int = 30) -> list[Tensor]:
    generator = np.random.default_rng(seed)
    return [torch.from_numpy(generator.normal(0.0, 0.1, (points, 3))) for _ in range(frames)]


def test_an_even_motion() -> None:
    step = torch.tensor([0.01, -0.02, 0.02]).double()
    figures = speed([lattice() + t * step for t in range(5)])
    assert figures.velocity == pytest.approx(0.03 * FPS)
    assert figures.acceleration == pytest.approx(0.0, abs=1e-9)


def test_an_even_acceleration() -> None:
    acceleration = 2.0
    way = [torch.tensor([0.5 * acceleration * (t / FPS) ** 2, 0.0, 0.0]).double() for t in range(8)]
    figures = speed([lattice() + x for x in way])
    assert figures.acceleration == pytest.approx(acceleration)
    assert figures.velocity == pytest.approx(way[-1][0].item() / 7 * FPS)


def test_slowing_down_counts_as_speeding_up() -> None:
    frames = [lattice() + torch.tensor([x, 0.0, 0.0]).double() for x in (0.0, 0.01, 0.03, 0.04)]
    assert speed(frames).acceleration == pytest.approx(0.01 * FPS * FPS)
    assert speed(frames[::-1]).acceleration == pytest.approx(0.01 * FPS * FPS)


@given(st.integers(0, 1000))
def test_equals_all_pairs(seed: int) -> None:
    frames = cloud(seed)
    pairs = pairwise(frames)
    speeds = np.array([cdist(now.numpy(), then.numpy()).min(axis=1).mean() for now, then in pairs]) * FPS
    figures = speed(frames)
    assert figures.velocity == pytest.approx(speeds.mean())
    assert figures.acceleration == pytest.approx(np.abs(np.diff(speeds)).mean() * FPS)


@given(st.integers(0, 1000))
def test_neither_order_nor_frame_of_reference_matter(seed: int) -> None:
    frames, generator = cloud(seed), np.random.default_rng(seed)
    turn = torch.from_numpy(Rotation.random(rng=generator).as_matrix())
    shuffled = [frame[torch.from_numpy(generator.permutation(len(frame)))] @ turn.T + 1.0 for frame in frames]
    np.testing.assert_allclose(speed(shuffled), speed(frames), rtol=1e-9)


def test_two_motions_together() -> None:
    first, second = cloud(0, 3), cloud(1, 6)
    meter, other = HairSpeed(FPS), HairSpeed(FPS)
    for frame in first:
        meter.add(frame)
    for frame in second:
        other.add(frame)
    meter.merge(other)
    one, two = speed(first), speed(second)
    assert meter.figures().velocity == pytest.approx((2 * one.velocity + 5 * two.velocity) / 7)
    assert meter.figures().acceleration == pytest.approx((one.acceleration + 4 * two.acceleration) / 5)


def test_too_few_frames() -> None:
    assert all(math.isnan(value) for value in speed(cloud(0, 1)))
    velocity, acceleration = speed(cloud(0, 2))
    assert velocity > 0
    assert math.isnan(acceleration)


def test_bad_input() -> None:
    with pytest.raises(DynhairError, match="frame rate"):
        HairSpeed(-1.0)
    with pytest.raises(DynhairError, match="no points"):
        HairSpeed(FPS).add(torch.zeros(0, 3))
