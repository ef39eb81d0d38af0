"""Hair motion explained, against closed forms and a plain loop."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.evaluation.hair_motion import HairMotion, motion_explained, nearest_points, tip_error_mm, to_head_frame


def strands(seed: int, count: int = 6, points: int = 5) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).normal(0.0, 0.1, (count, points, 3)))


def explained(motion: HairMotion, frames: list[tuple[Tensor, Tensor]]) -> float:
    errors = [motion.errors(avatar, truth) for avatar, truth in frames]
    return motion_explained(*np.mean(errors, axis=0))


@pytest.mark.parametrize(
    ("share", "expected"), [(1.0, 1.0), (0.0, 0.0), (2.0, 0.0), (0.5, 0.5), (-1.0, -1.0), (1.25, 0.75)]
)
def test_a_share_of_the_true_motion(share: float, expected: float) -> None:
    rest = strands(0)
    motion = HairMotion(rest, rest)
    shifts = [0.03 * strands(seed) for seed in (1, 2, 3)]
    frames = [(rest + share * shift, rest + shift) for shift in shifts]
    assert explained(motion, frames) == pytest.approx(expected, abs=1e-6)


def test_motion_at_right_angles_is_worse_than_none() -> None:
    rest = strands(0)
    right, up = torch.tensor([0.01, 0.0, 0.0]), torch.tensor([0.0, 0.01, 0.0])
    frames = [(rest + up.double(), rest + right.double())]
    assert explained(HairMotion(rest, rest), frames) == pytest.approx(1.0 - math.sqrt(2.0))


def test_a_uniform_motion_needs_no_common_points() -> None:
    rest, other = strands(0), strands(9, count=11, points=3)
    shift = torch.tensor([0.02, -0.01, 0.005], dtype=torch.float64)
    assert explained(HairMotion(other, rest), [(other + shift, rest + shift)]) == pytest.approx(1.0)


def test_equals_a_plain_loop_over_points() -> None:
    rest, truth_rest = strands(0, count=12), strands(1)
    deformed, truth = rest + 0.1 * strands(2, count=12), truth_rest + 0.1 * strands(3)
    points, moved = rest.reshape(-1, 3).numpy(), (deformed - rest).reshape(-1, 3).numpy()
    errors, motions = [], []
    for at_rest, now in zip(truth_rest.reshape(-1, 3).numpy(), truth.reshape(-1, 3).numpy(), strict=True):
        distances = np.linalg.norm(points - at_rest, axis=1)
        nearest = np.argsort(distances)[:4]
        displacement = np.average(moved[nearest], axis=0, weights=1.0 / distances[nearest])
        errors.append(np.linalg.norm(displacement - (now - at_rest)))
        motions.append(np.linalg.norm(now - at_rest))
    expected = (np.mean(errors), np.mean(motions))
    np.testing.assert_allclose(HairMotion(rest, truth_rest).errors(deformed, truth), expected, rtol=1e-12)


def test_hair_that_stands_still_explains_nothing() -> None:
    assert math.isnan(motion_explained(0.0, 0.0))
    assert math.isnan(motion_explained(1e-3, 1e-8))
    assert motion_explained(0.0, 1e-3) == 1.0


def test_fewer_points_than_neighbours() -> None:
    nearest, weights = nearest_points(torch.eye(3)[:2], torch.eye(3), 4)
    assert nearest.sort(dim=1).values.tolist() == [[0, 1]] * 3
    np.testing.assert_allclose(weights, [[1.0, 0.0], [1.0, 0.0], [0.5, 0.5]], atol=1e-8)


def test_a_single_point_of_the_avatar() -> None:
    nearest, weights = nearest_points(torch.zeros(1, 3), torch.eye(3), 4)
    assert nearest.tolist() == [[0]] * 3
    assert weights.tolist() == [[1.0]] * 3


@given(st.integers(0, 1000))
def test_the_head_frame_undoes_the_head_pose(seed: int) -> None:
    rotation = torch.from_numpy(Rotation.random(rng=np.random.default_rng(seed)).as_matrix())
    translation = torch.tensor([0.3, -1.0, 2.0], dtype=torch.float64)
    local = strands(seed)
    torch.testing.assert_close(to_head_frame(local @ rotation.T + translation, rotation, translation), local)


def test_the_truth_reaches_its_own_tips() -> None:
    rest, now = strands(0), strands(0) + 0.1 * strands(1)
    tips = HairMotion(rest, rest).tips(now)
    torch.testing.assert_close(tips, now[:, -1])
    assert tip_error_mm(tips, now[:, -1]) == pytest.approx(0.0, abs=1e-3)


def test_hair_at_rest_errs_by_the_tips_own_way() -> None:
    rest = strands(0)
    truth = rest.clone()
    truth[:, -1] += torch.tensor([0.003, 0.0, -0.004])
    motion = HairMotion(strands(5, count=9, points=3), rest)
    assert tip_error_mm(motion.tips(strands(5, count=9, points=3)), truth[:, -1]) == pytest.approx(5.0)


def test_tips_move_as_the_points_nearest_to_them_at_rest() -> None:
    rest, truth_rest = strands(0, count=12), strands(1)
    deformed = rest + 0.1 * strands(2, count=12)
    points, moved = rest.reshape(-1, 3).numpy(), (deformed - rest).reshape(-1, 3).numpy()
    expected = []
    for tip in truth_rest[:, -1].numpy():
        distances = np.linalg.norm(points - tip, axis=1)
        nearest = np.argsort(distances)[:4]
        expected.append(tip + np.average(moved[nearest], axis=0, weights=1.0 / distances[nearest]))
    np.testing.assert_allclose(HairMotion(rest, truth_rest).tips(deformed), expected, rtol=1e-12)
