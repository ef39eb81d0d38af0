"""The modal deformer against SciPy's matrix exponential and its formulas written out."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from torch.nn import functional

from dynhair.avatar import ModalDeformer
from dynhair.avatar.deformer import DISPLACEMENT_UNIT
from dynhair.avatar.modal import LEAST_DAMPING, MOST_DAMPING, Oscillators
from dynhair.config import DeformerConfig

CONFIG = DeformerConfig(
    kind="modal", history=12, modes=4, position_frequencies=2, place_frequencies=2, width=16, layers=2, knots=3
)


def canonical(strands: int = 5, points: int = 7) -> torch.Tensor:
    return torch.randn(strands, points, 3, generator=torch.Generator().manual_seed(0)) * 0.1


def lively(deformer: ModalDeformer) -> ModalDeformer:
    """With weights of the order of one in every layer, unlike a fresh network."""
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in deformer.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=generator, dtype=parameter.dtype) * 0.3)
    return deformer


def windows(count: int, frames: int, seed: int = 2) -> torch.Tensor:
    return torch.randn(count, frames, 9, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@given(st.floats(0.05, 2.0), st.floats(0.03, 0.97), st.integers(1, 30), st.integers(0, 1000))
def test_an_oscillator_moves_exactly_under_a_force_held_from_frame_to_frame(
    frequency: float, damping: float, frames: int, seed: int
) -> None:
    oscillators = Oscillators(1).double()
    share = (damping - LEAST_DAMPING) / (MOST_DAMPING - LEAST_DAMPING)
    with torch.no_grad():
        oscillators.log_frequency.fill_(np.log(frequency))
        oscillators.damping_logit.fill_(np.log(share / (1 - share)))
    forces = np.random.default_rng(seed).normal(size=frames)
    # position, velocity and the force itself, which stays as it is from frame to frame
    system = np.array([[0.0, 1.0, 0.0], [-(frequency**2), -2 * damping * frequency, frequency**2], [0.0, 0.0, 0.0]])
    step = np.asarray(expm(system))
    state = np.array([forces[0], 0.0, 0.0])
    for force in forces[1:]:
        state = step @ np.array([state[0], state[1], force])
    found = oscillators(torch.from_numpy(forces)[:, None])
    assert found.item() == pytest.approx(state[0], abs=1e-9)


def test_displacements_are_mode_shapes_times_amplitudes() -> None:
    deformer, window = lively(ModalDeformer(canonical(), CONFIG).double()), windows(1, 13)
    omega = window[0, :, :3]
    products = torch.stack([omega[:, i] * omega[:, j] for i in range(3) for j in range(i, 3)], 1)
    forces = torch.cat([window[0], products], 1) @ deformer.forces.weight.T
    amplitudes = deformer.oscillators(forces)
    hidden = deformer.code.double()
    for layer in deformer.mlp:
        assert isinstance(layer, torch.nn.Linear)
        hidden = functional.leaky_relu(layer(hidden))
    shapes = deformer.shapes(hidden).view(-1, 3, CONFIG.modes)
    at_knots = (shapes @ amplitudes).view(3, 5, 3)
    along = torch.einsum("lk,knc->nlc", deformer.spline.double(), at_knots)
    expected = DISPLACEMENT_UNIT * deformer.root_attenuation[:, None] * along
    torch.testing.assert_close(deformer.double()(window[0]), expected)


def test_a_still_head_leaves_the_hair_canonical() -> None:
    deformer = lively(ModalDeformer(canonical(), CONFIG))
    assert deformer(torch.zeros(13, 9)).abs().max() == 0


def test_what_is_over_is_forgotten() -> None:
    deformer = ModalDeformer(canonical(), CONFIG)
    push = torch.zeros(400, 9)
    push[1:20] = 1.0
    moved = [deformer(push[: 21 + after]).norm().item() for after in (0, 100, 350)]
    assert moved[0] > 0
    assert moved[1] < 0.2 * moved[0]
    assert moved[2] < 1e-4 * moved[0]


def test_it_overshoots_after_a_sudden_stop() -> None:
    oscillators = Oscillators(1)
    forces = torch.cat([torch.ones(60), torch.zeros(60)])[:, None]
    swing = torch.stack([oscillators(forces[: 61 + after])[0] for after in range(59)])
    assert swing.min() < -0.1  # past its place of rest
    assert swing[-1].abs() < swing.abs().max()


def test_a_shorter_past_is_a_past_at_rest() -> None:
    deformer, window = lively(ModalDeformer(canonical(), CONFIG)), windows(1, 6)[0].float()
    padded = torch.cat([window[:1].expand(9, -1), window])
    torch.testing.assert_close(deformer(padded), deformer(window))


def test_gradients_reach_every_parameter_and_are_right() -> None:
    deformer, window = lively(ModalDeformer(canonical(2, 4), CONFIG).double()), windows(1, 5)[0]
    deformer(window).square().sum().backward()
    for name, parameter in deformer.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().max() > 0, name
    frequency = deformer.oscillators.log_frequency
    assert frequency.grad is not None
    found, step = frequency.grad[1].item(), 1e-6
    with torch.no_grad():
        values = []
        for sign in (1, -1):
            frequency[1] += sign * step
            values.append(deformer(window).square().sum().item())
            frequency[1] -= sign * step
    assert found == pytest.approx((values[0] - values[1]) / (2 * step), rel=1e-4)
