"""so3_exp and so3_log against SciPy, at every angle."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.motion import so3_exp, so3_log

ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 0.3, 1.5, 3.0, np.pi - 1e-6, np.pi - 1e-10, np.pi]
AXES = np.concatenate([np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(20, 3))])


def vectors(angle: float) -> np.ndarray:
    return AXES / np.linalg.norm(AXES, axis=1, keepdims=True) * angle


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_agrees_with_scipy(angle: float) -> None:
    expected = Rotation.from_rotvec(vectors(angle)).as_matrix()
    np.testing.assert_allclose(so3_exp(torch.tensor(vectors(angle))).numpy(), expected, atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_log_agrees_with_scipy(angle: float) -> None:
    matrices = Rotation.from_rotvec(vectors(angle)).as_matrix()
    found = so3_log(torch.tensor(matrices)).numpy()
    expected = vectors(angle)
    if angle > np.pi - 1e-8:  # the axis is only known up to its sign
        signs = np.sign((found * expected).sum(axis=1, keepdims=True))
        found = found * signs
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15 if angle < 1e-3 else 1e-9)


@given(st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3))
def test_log_undoes_exp(vector: list[float]) -> None:  # norms stay below pi, where the logarithm is unique
    omega = torch.tensor(vector, dtype=torch.float64)
    torch.testing.assert_close(so3_log(so3_exp(omega)), omega, rtol=0, atol=1e-9)


def test_batches_of_any_rank_and_none() -> None:
    assert so3_exp(torch.zeros(2, 5, 3)).shape == (2, 5, 3, 3)
    assert so3_log(torch.eye(3)).shape == (3,)
    assert so3_log(torch.zeros(0, 3, 3)).shape == (0, 3)


def test_gradients_are_finite_at_rest() -> None:
    omega = torch.zeros(4, 3, dtype=torch.float64, requires_grad=True)
    so3_log(so3_exp(omega)).sum().backward()
    assert omega.grad is not None
    torch.testing.assert_close(omega.grad, torch.ones_like(omega))
