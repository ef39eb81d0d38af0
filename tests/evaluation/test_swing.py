"""Lag of a swing, against pendulums whose lag is known and SciPy's cross-correlation."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import correlate
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.evaluation.swing import LEAST_SWING, MOST_LAG, phase_lag_ms

FPS = 30.0
AXIS = np.array([0.6, 0.0, -0.8])


def pendulum(lag: float = 0.0, amplitude: float = 0.03, frames: int = 120, frequency: float = 1.3) -> Tensor:
    """Swings that die down, ``lag`` seconds late, along one axis and a little along another."""
    time = np.arange(frames) / FPS - lag
    swing = amplitude * np.exp(-0.3 * time) * np.sin(2 * np.pi * frequency * time)
    return torch.from_numpy(swing[:, None] * AXIS + 0.2 * swing[:, None] ** 2 + np.array([0.1, -0.2, 0.05]))


@given(st.floats(-0.12, 0.12))
def test_a_known_lag_between_frames(lag: float) -> None:
    found = phase_lag_ms(pendulum(lag), pendulum(), FPS)
    assert found == pytest.approx(1e3 * lag, abs=2.0)


@given(st.floats(0.01, 10.0), st.integers(0, 1000))
def test_size_and_place_of_the_swing_do_not_matter(size: float, seed: int) -> None:
    late, truth = pendulum(0.07), pendulum()
    turn = torch.from_numpy(Rotation.random(rng=np.random.default_rng(seed)).as_matrix())
    found = phase_lag_ms((size * late + 0.3) @ turn.T, truth @ turn.T, FPS)
    assert found == pytest.approx(phase_lag_ms(late, truth, FPS), abs=1e-6)


def test_the_truth_itself_has_no_lag() -> None:
    assert phase_lag_ms(pendulum(), pendulum(), FPS) == pytest.approx(0.0, abs=1e-9)


def test_early_is_as_far_as_late() -> None:
    late = phase_lag_ms(pendulum(0.05), pendulum(), FPS)
    early = phase_lag_ms(pendulum(), pendulum(0.05), FPS)
    assert late is not None
    assert early == pytest.approx(-late, abs=0.5)


@pytest.mark.parametrize("frames", [2, 5, -3])
def test_agrees_with_plain_cross_correlation(frames: int) -> None:
    """Of a burst with rest on both sides, whose overlap is the same at any lag."""
    generator = np.random.default_rng(0)
    burst = np.zeros(120)
    burst[40:70] = np.hanning(30) * generator.normal(0.0, 0.05, 30)
    truth = torch.from_numpy(np.outer(burst, AXIS))
    moved = torch.from_numpy(np.outer(np.roll(burst, frames), AXIS))
    peak = int(correlate(np.roll(burst, frames), burst, mode="full").argmax()) - 119
    found = phase_lag_ms(moved, truth, FPS)
    assert found is not None
    assert peak == frames
    assert round(found / 1e3 * FPS) == peak


def test_other_axes_are_not_seen() -> None:
    across = torch.from_numpy(np.outer(0.01 * np.sin(np.arange(120)), [0.8, 0.0, 0.6]))
    assert phase_lag_ms(pendulum(0.05) + across, pendulum(), FPS) == pytest.approx(
        phase_lag_ms(pendulum(0.05), pendulum(), FPS), abs=2.0
    )


def test_no_lag_where_there_is_none() -> None:
    truth = pendulum()
    assert phase_lag_ms(truth, pendulum(amplitude=LEAST_SWING), FPS) is None  # the truth hardly swings
    assert phase_lag_ms(torch.zeros(120, 3).double(), truth, FPS) is None
    noise = torch.from_numpy(np.random.default_rng(0).normal(0.0, 0.03, (120, 3)))
    assert phase_lag_ms(noise, truth, FPS) is None
    slow = pendulum(frequency=0.2)
    assert phase_lag_ms(pendulum(1.3 * MOST_LAG, frequency=0.2), slow, FPS) is None  # further than is searched
    assert phase_lag_ms(truth[:20], truth[:20], FPS) is None
    assert phase_lag_ms(truth[:0], truth[:0], FPS) is None


def test_bad_input() -> None:
    with pytest.raises(DynhairError, match="frame rate"):
        phase_lag_ms(pendulum(), pendulum(), math.nan)
