"""The temporal prior, its banded systems and what is learnt of noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dynhair.preprocess.tracking.banded import BlockBanded
from dynhair.preprocess.tracking.head_motion import POSE, HeadMotion
from dynhair.preprocess.tracking.noise import (
    NoiseLevels,
    PoseMeasurements,
    estimate_noise,
    negative_log_likelihood,
    posterior_noise,
)
from dynhair.preprocess.tracking.smoothness import Smoothness, inverse_left_jacobian, third_differences

LEVELS = NoiseLevels(1.0, 40.0, 2.0)


def random_motion(rng: np.random.Generator, frames: int, expressions: int = 2) -> HeadMotion:
    vectors = np.cumsum(0.3 * rng.normal(size=(frames, 3)), axis=0)
    return HeadMotion(
        Rotation.from_rotvec(vectors).as_matrix(),
        0.1 * rng.normal(size=(frames, 3)),
        rng.uniform(size=(frames, expressions)),
    )


@pytest.mark.parametrize("frames", [1, 2, 3, 5, 9])
def test_banded_solver_against_a_dense_one(frames: int) -> None:
    rng = np.random.default_rng(frames)
    blocks = rng.normal(size=(frames, 4, 5, 5))
    blocks[:, 0] += blocks[:, 0].swapaxes(-1, -2) + 60 * np.eye(5)
    for distance in range(1, 4):
        blocks[max(frames - distance, 0) :, distance] = 0
    system = BlockBanded(blocks)
    dense = system.dense()
    np.testing.assert_array_equal(dense, dense.T)
    right = rng.normal(size=(frames, 5, 2))
    factor = system.factorised()
    expected = np.linalg.solve(dense, right.reshape(-1, 2)).reshape(right.shape)
    np.testing.assert_allclose(factor.solve(right), expected, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(factor.solve(right[..., 0]), expected[..., 0], rtol=1e-10, atol=1e-12)
    assert factor.log_determinant() == pytest.approx(np.linalg.slogdet(dense)[1])


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 7])
def test_gradient_of_smoothness_against_finite_differences(frames: int) -> None:
    rng = np.random.default_rng(frames)
    motion = random_motion(rng, frames)
    smoothness = Smoothness(40.0, 2.0, 30.0, 30.0)
    gradient, _ = smoothness.linearised(motion)
    for _ in range(4):
        step = rng.normal(size=gradient.shape)
        slope = (smoothness.cost(motion.moved(1e-6 * step)) - smoothness.cost(motion.moved(-1e-6 * step))) / 2e-6
        assert (gradient * step).sum() == pytest.approx(slope, rel=1e-5, abs=1e-4)


def test_curvature_of_smoothness_is_that_of_a_smooth_motion() -> None:
    """Where differences vanish, Gauss and Newton's curvature is exact."""
    frames = 8
    turn = Rotation.from_rotvec([0.1, -0.2, 0.15])
    rotations = np.stack([(turn**t).as_matrix() for t in range(frames)])
    motion = HeadMotion(rotations, np.outer(np.arange(frames), [0.1, 0.2, 0.3]), np.zeros((frames, 1)))
    smoothness = Smoothness(40.0, 2.0, 30.0, 30.0)
    _, system = smoothness.linearised(motion)
    rng = np.random.default_rng(0)
    step = rng.normal(size=(frames, POSE + 1))
    curvature = step.ravel() @ system.dense() @ step.ravel()
    assert 2 * smoothness.cost(motion.moved(1e-5 * step)) / 1e-10 == pytest.approx(curvature, rel=1e-3)


def test_inverse_left_jacobian_against_finite_differences() -> None:
    rng = np.random.default_rng(0)
    for vector in [np.zeros(3), 1e-4 * rng.normal(size=3), rng.normal(size=3), 2.5 * np.array([0.6, 0, -0.8])]:
        slopes = [
            (Rotation.from_rotvec(1e-6 * axis) * Rotation.from_rotvec(vector)).as_rotvec()
            - (Rotation.from_rotvec(-1e-6 * axis) * Rotation.from_rotvec(vector)).as_rotvec()
            for axis in np.eye(3)
        ]
        np.testing.assert_allclose(inverse_left_jacobian(vector[None])[0], np.stack(slopes, 1) / 2e-6, atol=1e-7)


def measured(rng: np.random.Generator, frames: int, levels: NoiseLevels, fps: float = 30.0) -> PoseMeasurements:
    """Random motion of the prior's own kind, measured with errors; counted about rest."""
    jerk = np.repeat([levels.angular_jerk, levels.linear_jerk], 3) * fps**-2.5 * rng.normal(size=(frames, POSE))
    path = np.cumsum(np.cumsum(np.cumsum(jerk, 0), 0), 0)
    information = np.diag(np.repeat([1e5, 1e7], 3))
    errors = rng.normal(size=(frames, POSE)) / np.sqrt(levels.confidence * np.diag(information))
    rest = HeadMotion(np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3)), np.zeros((frames, 0)))
    return PoseMeasurements(rest, -(path + errors) @ information, np.tile(information, (frames, 1, 1)), fps)


def test_likelihood_against_the_density_of_third_differences() -> None:
    """What is left of the measurements without the prior's free motion is normal: the same up to a constant."""
    take = measured(np.random.default_rng(0), 12, LEVELS)
    observed = -take.gradient @ np.linalg.inv(take.information[0])
    differences = np.diff(observed, 3, axis=0)
    stencil = np.diff(np.eye(12), 3, axis=0)

    def direct(levels: NoiseLevels) -> float:
        total = 0.0
        jerks = np.repeat([levels.angular_jerk, levels.linear_jerk], 3) * 30.0**-2.5
        for axis, jerk in enumerate(jerks):
            noise = 1 / (levels.confidence * take.information[0, axis, axis])
            covariance = jerk**2 * np.eye(9) + noise * stencil @ stencil.T
            value = differences[:, axis]
            total += (value @ np.linalg.solve(covariance, value) + np.linalg.slogdet(covariance)[1]) / 2
        return float(total)

    others = [
        NoiseLevels(*values) for values in ((2.0, 40.0, 2.0), (1.0, 80.0, 2.0), (0.5, 30.0, 5.0), (1.0, 40.0, 1.0))
    ]
    for other in others:
        expected = direct(other) - direct(LEVELS)
        found = negative_log_likelihood([take], other) - negative_log_likelihood([take], LEVELS)
        assert found == pytest.approx(expected, abs=0.02)


def test_levels_are_found_again() -> None:
    true = NoiseLevels(0.3, 60.0, 1.5)
    rng = np.random.default_rng(1)
    takes = [measured(rng, 80, true) for _ in range(3)]
    for found in estimate_noise(takes, NoiseLevels(1.0, 10.0, 10.0)):
        assert found.confidence == pytest.approx(true.confidence, rel=0.3)
        assert found.angular_jerk == pytest.approx(true.angular_jerk, rel=0.4)
        assert found.linear_jerk == pytest.approx(true.linear_jerk, rel=0.4)


def test_short_takes_leave_the_levels_as_they_are() -> None:
    take = measured(np.random.default_rng(0), 6, LEVELS)
    assert estimate_noise([take], LEVELS) == [LEVELS]


def test_posterior_noise_against_the_dense_covariance() -> None:
    take = measured(np.random.default_rng(0), 9, LEVELS)
    covariance = np.linalg.inv(take.posterior(LEVELS)[1].dense())
    omega, alpha = [], []
    for frame in range(2, 7):
        for axis in range(3):
            weights = np.zeros((2, 9, POSE))
            weights[0, [frame + 1, frame - 1], axis] = 15.0, -15.0
            weights[1, [frame + 2, frame, frame - 2], axis] = 225.0, -450.0, 225.0
            omega.append(weights[0].ravel() @ covariance @ weights[0].ravel())
            alpha.append(weights[1].ravel() @ covariance @ weights[1].ravel())
    noise = posterior_noise([take], [LEVELS])
    assert noise is not None
    assert noise.omega == pytest.approx(np.sqrt(np.mean(omega)))
    assert noise.alpha == pytest.approx(np.sqrt(np.mean(alpha)))


def test_third_differences_of_steady_acceleration_vanish() -> None:
    frames = np.arange(6.0)
    rotations = Rotation.from_rotvec(np.outer(0.01 * frames**2, [0, 1, 0])).as_matrix()
    motion = HeadMotion(rotations, np.outer(frames**2, [1.0, 2, 3]), np.zeros((6, 0)))
    np.testing.assert_allclose(third_differences(motion), 0, atol=1e-12)
