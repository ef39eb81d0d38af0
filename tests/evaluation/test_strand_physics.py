"""Physical realism of strands, against closed forms and the paper's formulas written out on whole arrays."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.evaluation.hair_motion import to_head_frame
from dynhair.evaluation.quantiles import RELATIVE_ERROR
from dynhair.evaluation.strand_physics import LEAST_SPEED, PhysicsFigures, StrandPhysics

FPS = 30.0


def motion(seed: int, frames: int = 8, strands: int = 5, points: int = 6) -> Tensor:
    generator = np.random.default_rng(seed)
    rest = generator.normal(0.0, 0.1, (strands, points, 3))
    steps = generator.normal(0.0, 0.003, (frames, strands, points, 3))
    return torch.from_numpy(rest + np.cumsum(steps, axis=0))


def physics(frames: Tensor, fps: float = FPS) -> StrandPhysics:
    meter = StrandPhysics(fps)
    for frame in frames:
        meter.add(frame)
    return meter


def written_out(p: np.ndarray, fps: float = FPS) -> PhysicsFigures:
    """The formulas of the paper, on all frames at once."""
    v = (p[1:] - p[:-1]) * fps
    speed = np.linalg.norm(v, axis=-1)
    curvature = p[:, :, 2:] - 2 * p[:, :, 1:-1] + p[:, :, :-2]
    momentum = np.cross(p[:-1] - p[:-1].mean(axis=(1, 2), keepdims=True), v).sum(axis=(1, 2))
    return PhysicsFigures(
        ver=speed.max() / (np.quantile(speed, 0.5, method="inverted_cdf") + LEAST_SPEED),
        cts=np.linalg.norm(curvature[1:] - curvature[:-1], axis=-1).mean(),
        p95_disp=float(np.percentile(np.linalg.norm(p[1:] - p[:-1], axis=-1).max(axis=(1, 2)), 95)),
        amd=np.linalg.norm(momentum - momentum[0], axis=-1).mean(),
    )


def assert_same(found: PhysicsFigures, expected: PhysicsFigures, rtol: float = 1e-9) -> None:
    assert found.ver == pytest.approx(expected.ver, rel=2 * RELATIVE_ERROR)
    np.testing.assert_allclose(found[1:], expected[1:], rtol=rtol, atol=1e-12)


@given(st.integers(0, 10_000), st.integers(2, 12))
def test_equals_the_formulas(seed: int, frames: int) -> None:
    moving = motion(seed, frames)
    assert_same(physics(moving).figures(), written_out(moving.numpy()))


def test_an_even_translation() -> None:
    step = torch.tensor([0.003, 0.004, 0.0], dtype=torch.float64)
    figures = physics(motion(0, 1) + torch.arange(5).double()[:, None, None, None] * step).figures()
    assert figures.ver == pytest.approx(1.0, abs=LEAST_SPEED / 0.15 + 2 * RELATIVE_ERROR)
    assert figures.cts == pytest.approx(0.0, abs=1e-12)
    assert figures.p95_disp == pytest.approx(0.005)
    assert figures.amd == pytest.approx(0.0, abs=1e-12)


def test_an_even_rotation_has_the_speeds_of_its_radii_and_keeps_its_momentum() -> None:
    radii = torch.tensor([0.1, 0.2, 0.3, 0.4, 0.5], dtype=torch.float64)
    ray = torch.stack([radii, torch.zeros(5), torch.zeros(5)], dim=1)
    rest = torch.stack([ray, -ray])  # about its own centre
    angle = 0.05
    turns = torch.from_numpy(Rotation.from_rotvec([[0.0, 0.0, angle * t] for t in range(9)]).as_matrix())
    figures = physics(torch.stack([rest @ turn.T for turn in turns])).figures()
    chord = 2 * math.sin(angle / 2)
    assert figures.ver == pytest.approx(0.5 / (0.3 + LEAST_SPEED / (chord * FPS)), rel=2 * RELATIVE_ERROR)
    assert figures.p95_disp == pytest.approx(0.5 * chord)
    assert figures.amd == pytest.approx(0.0, abs=1e-12)
    assert figures.cts == pytest.approx(0.0, abs=1e-12)


def test_a_rotation_that_speeds_up_drifts_by_its_momentum() -> None:
    rest = torch.tensor([[[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]], [[-0.1, 0.0, 0.0], [-0.2, 0.0, 0.0]]]).double()
    angles = np.array([0.0, 0.1, 0.3, 0.6])
    turns = torch.from_numpy(Rotation.from_rotvec(np.outer(angles, [0.0, 1.0, 0.0])).as_matrix())
    moving = torch.cat([rest, torch.zeros(2, 1, 3).double()], dim=1)
    momenta = 2 * (0.1**2 + 0.2**2) * np.sin(np.diff(angles)) * FPS
    figures = physics(torch.stack([moving @ turn.T for turn in turns])).figures()
    assert figures.amd == pytest.approx(np.mean(np.abs(momenta - momenta[0])))


def test_a_bend_that_comes_and_goes() -> None:
    straight = torch.zeros(1, 3, 3).double()
    straight[0, :, 1] = torch.tensor([0.0, -0.1, -0.2])
    bent = straight.clone()
    bent[0, 1, 0] = 0.01
    assert physics(torch.stack([straight, bent, straight])).figures().cts == pytest.approx(0.02)


@given(st.integers(0, 1000))
def test_the_order_of_strands_does_not_matter(seed: int) -> None:
    moving = motion(seed)
    order = torch.from_numpy(np.random.default_rng(seed).permutation(moving.shape[1]))
    assert_same(physics(moving[:, order]).figures(), physics(moving).figures())


@given(st.integers(0, 1000))
def test_the_motion_of_the_head_does_not_matter(seed: int) -> None:
    local = motion(seed)
    generator = np.random.default_rng(seed)
    poses = [
        (torch.from_numpy(Rotation.random(rng=generator).as_matrix()), torch.from_numpy(generator.normal(0, 1, 3)))
        for _ in local
    ]
    world = [frame @ rotation.T + shift for frame, (rotation, shift) in zip(local, poses, strict=True)]
    back = torch.stack([to_head_frame(frame, *pose) for frame, pose in zip(world, poses, strict=True)])
    assert_same(physics(back).figures(), physics(local).figures(), rtol=1e-6)


def test_hair_that_stands_still_but_for_rounding() -> None:
    rest = motion(0, 1)[0]
    noise = 1e-8 * motion(1, 6)
    assert physics(rest + noise).figures().ver < 0.01


def test_two_motions_together() -> None:
    first, second = motion(1, 4), motion(2, 7)
    both, second_meter = physics(first), physics(second)
    both.merge(second_meter)
    one, two = written_out(first.numpy()), written_out(second.numpy())
    together = both.figures()
    assert together.cts == pytest.approx((3 * one.cts + 6 * two.cts) / 9)
    assert together.amd == pytest.approx((3 * one.amd + 6 * two.amd) / 9)
    distances = [np.linalg.norm(np.diff(p.numpy(), axis=0), axis=-1) for p in (first, second)]
    assert together.p95_disp == pytest.approx(np.percentile(np.concatenate([d.max((1, 2)) for d in distances]), 95))
    speeds = FPS * np.concatenate([d.ravel() for d in distances])
    median = np.quantile(speeds, 0.5, method="inverted_cdf")
    assert together.ver == pytest.approx(speeds.max() / (median + LEAST_SPEED), rel=2 * RELATIVE_ERROR)


@pytest.mark.parametrize("frames", [0, 1])
def test_nothing_moves_in_one_frame(frames: int) -> None:
    assert all(math.isnan(value) for value in physics(motion(0, 1)[:frames]).figures())


def test_bad_input() -> None:
    with pytest.raises(DynhairError, match="frame rate"):
        StrandPhysics(0.0)
    meter = physics(motion(0, 1))
    with pytest.raises(DynhairError, match="strands of shape"):
        meter.add(motion(0, 1, strands=4)[0])
