"""Dynamics of single strands: physics that must hold, whatever is learned, and that they learn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from made_motions import made_motion
from scipy.spatial.transform import Rotation
from studies.hair_motion.fitting import fitted, score
from studies.hair_motion.motions import FPS
from studies.hair_motion.recordings import Recorded
from studies.hair_motion.strand_dynamics import (
    ALPHA,
    OMEGA,
    PLACE,
    PULL,
    REST_UNIT,
    ROOT_FREQUENCIES,
    ROOT_UNIT,
    STEP,
    Dynamics,
    HeadMotions,
    StrandDynamics,
    inertial_pull,
)
from torch.nn.functional import silu

from dynhair.avatar.encoding import positional_encoding

SMALL = Dynamics(hidden=24, noise=0.01)
NECK = torch.tensor([0.01, -0.05, 0.02])


@given(st.integers(0, 2**31))
def test_what_moves_straight_in_the_world_is_pulled_as_it_is_seen_to_turn(seed: int) -> None:
    generator = np.random.default_rng(seed)
    axis, rate, growth = generator.standard_normal(3), generator.uniform(-3, 3), generator.uniform(-20, 20)
    axis /= np.linalg.norm(axis)
    start, velocity = generator.standard_normal((2, 3))
    step = 1e-4

    def seen(time: float) -> np.ndarray:
        turn = Rotation.from_rotvec(axis * (rate * time + growth * time**2 / 2))
        return turn.inv().apply(start + velocity * time)

    place, speed = seen(0.0), (seen(step) - seen(-step)) / (2 * step)
    expected = (seen(step) - 2 * place + seen(-step)) / step**2
    by_place, by_velocity = inertial_pull(torch.from_numpy(axis * rate), torch.from_numpy(axis * growth))
    found = by_place.numpy() @ place + by_velocity.numpy() @ speed
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)


def test_frames_are_those_of_the_network_written_out_strand_by_strand() -> None:
    torch.manual_seed(1)
    motions = [made_motion("turn"), made_motion("random1")]
    network = StrandDynamics(5, 8, NECK).double()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    canonical = torch.stack([motion.canonical for motion in motions]).double()
    found = network(canonical, _double(HeadMotions.of(motions, slice(0, 12))))
    for motion, frames in zip(motions, found, strict=True):
        for strand in range(2):
            expected = _written_out(network, motion, strand, 12)
            torch.testing.assert_close(frames[:, strand], expected, rtol=1e-9, atol=1e-12)
    assert found[:, -1].abs().max() > 1e-3


def _double(head: HeadMotions) -> HeadMotions:
    return HeadMotions(*(getattr(head, name).double() for name in ("omega", "alpha", "rotation", "weight")))


def _written_out(network: StrandDynamics, motion: Recorded, number: int, frames: int) -> torch.Tensor:
    """One strand's displacements, point by point and force by force."""
    signals, rest = motion.signals, motion.canonical[number].double()
    placed, velocity = torch.zeros_like(rest), torch.zeros_like(rest)
    lies = torch.cat([((rest - network.neck) / REST_UNIT).flatten(), _encoded((rest[0] - network.neck) / ROOT_UNIT)])
    said = [placed]
    for frame in range(1, frames):
        omega, alpha = signals.omega[frame].double(), signals.alpha[frame].double()
        weight = (signals.pull[frame] - signals.pull[0]).double()
        turn = torch.from_numpy(Rotation.from_rotvec(signals.rotation[frame].double().numpy()).as_matrix())
        seen = []
        for point in range(len(rest)):
            place, speed = rest[point] + placed[point], velocity[point] * FPS
            pull = weight - torch.linalg.cross(alpha, place) - 2 * torch.linalg.cross(omega, speed)
            pull = pull - torch.linalg.cross(omega, torch.linalg.cross(omega, place))
            slid = turn @ (place - network.neck) + network.neck - rest[point]
            seen += [placed[point] / PLACE, velocity[point] / STEP, pull / PULL, slid / PLACE]
        head = torch.cat([omega / OMEGA, alpha / ALPHA, weight / PULL])
        hidden = network.of_points(torch.cat(seen)) + network.of_rest(lies) + network.of_head(head)
        gained = network.gain(silu(network.middle(silu(hidden)))).view(-1, 3)
        kept = 1 - torch.sigmoid(network.loss_logit)
        velocity = kept * velocity + STEP * network.freedom * gained
        placed = placed + velocity
        said.append(placed)
    return torch.stack(said).detach()


def _encoded(values: torch.Tensor) -> torch.Tensor:
    return positional_encoding(values[None], ROOT_FREQUENCIES)[0]


def test_a_motion_can_be_taken_up_in_any_frame() -> None:
    torch.manual_seed(2)
    motion = made_motion("random1")
    network = StrandDynamics(5, 8, NECK)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.2 * torch.randn_like(parameter))
        canonical = motion.canonical[None]
        whole = network(canonical, HeadMotions.of([motion]))
        start = (whole[:, 20], whole[:, 20] - whole[:, 19])
        again = network(canonical, HeadMotions.of([motion], slice(20, 40)), start)
    torch.testing.assert_close(again, whole[:, 20:40], rtol=1e-3, atol=1e-6)


def test_before_it_has_learned_hair_rests() -> None:
    motion = made_motion("turn")
    network = StrandDynamics(5, 8, NECK)
    torch.nn.init.zeros_(network.gain.weight)
    assert not network(motion.canonical[None], HeadMotions.of([motion])).any()


@pytest.mark.parametrize("row", [SMALL, replace(SMALL, mirror=False, noise=0.0)])
def test_a_fit_can_be_repeated(row: Dynamics) -> None:
    motion = made_motion("turn")
    first, second = (fitted(row, [motion], seed=4, steps=3)(motion) for _ in range(2))
    torch.testing.assert_close(first, second, rtol=0, atol=0)
    assert not torch.equal(first, fitted(row, [motion], seed=5, steps=3)(motion))
    assert first.shape == motion.displacements.shape


@pytest.mark.slow
def test_strands_learn_how_strands_move() -> None:
    row, learned = Dynamics(hidden=64, noise=0.01), [made_motion("turn"), made_motion("random1")]
    assert abs(score(fitted(row, learned, steps=0), learned)) < 0.1
    assert score(fitted(row, learned, steps=150), learned) > 0.4
