"""Dynamics of single strands: physics that must hold, whatever is learned."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch.nn.functional import silu

from dynhair.avatar.encoding import positional_encoding
from dynhair.avatar.strand_dynamics import (
    ALPHA,
    FORGOTTEN,
    FPS,
    OMEGA,
    PLACE,
    POINTS,
    PULL,
    REST_UNIT,
    ROOT_FREQUENCIES,
    ROOT_UNIT,
    STEP,
    HeadMotions,
    StrandDynamics,
    StrandStates,
    inertial_pull,
)
from dynhair.strands import strand_lengths

NECK = torch.tensor([0.01, -0.05, 0.02])
FRAMES = 40


def network(seed: int = 1, by: float = 0.3) -> StrandDynamics:
    """With weights of the order of one in every layer, unlike a fresh network."""
    torch.manual_seed(seed)
    lively = StrandDynamics(5, 8, NECK).double()
    with torch.no_grad():
        for parameter in lively.parameters():
            parameter.add_(by * torch.randn_like(parameter))
    return lively


def strands(motions: int = 2, count: int = 3) -> torch.Tensor:
    generator = torch.Generator().manual_seed(2)
    steps = 0.03 * torch.randn(motions, count, 5, 3, generator=generator, dtype=torch.float64)
    return 0.1 + steps.cumsum(2)


def motions(count: int = 2, frames: int = FRAMES, size: float = 1.0) -> HeadMotions:
    generator = torch.Generator().manual_seed(3)

    def swinging(most: float) -> torch.Tensor:
        swings = torch.randn(count, frames, 3, generator=generator, dtype=torch.float64)
        return size * most * swings.cumsum(1).sin()

    return HeadMotions(swinging(3), swinging(30), swinging(0.5), swinging(4))


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
    lively, rest, head = network(), strands(), motions(frames=12)
    with torch.no_grad():
        found = lively(rest, head)
        for motion in range(2):
            for strand in range(3):
                alone = HeadMotions(*(part[motion] for part in head))
                expected = _written_out(lively, rest[motion, strand], alone)
                torch.testing.assert_close(found[motion, :, strand], expected, rtol=1e-9, atol=1e-12)
    assert found[:, -1].abs().max() > 1e-3


def _written_out(lively: StrandDynamics, rest: torch.Tensor, head: HeadMotions) -> torch.Tensor:
    """One strand's displacements, point by point and force by force."""
    placed, velocity = torch.zeros_like(rest), torch.zeros_like(rest)
    root = positional_encoding((rest[:1] - lively.neck) / ROOT_UNIT, ROOT_FREQUENCIES)[0]
    lies = lively.of_rest(torch.cat([((rest - lively.neck) / REST_UNIT).flatten(), root]))
    at_rest = lively.gain(silu(lively.middle(silu(lively.of_points.bias + lies))))
    from_root = torch.cat([torch.zeros(1), rest.diff(dim=0).norm(dim=1).cumsum(0)])[:, None]
    said = [placed]
    for frame in range(1, len(head.omega)):
        omega, alpha, turned, weight = (part[frame] for part in head)
        turn = torch.from_numpy(Rotation.from_rotvec(turned.numpy()).as_matrix())
        seen = []
        for point in range(len(rest)):
            place, speed = rest[point] + placed[point], velocity[point] * FPS
            pull = weight - torch.linalg.cross(alpha, place) - 2 * torch.linalg.cross(omega, speed)
            pull = pull - torch.linalg.cross(omega, torch.linalg.cross(omega, place))
            slid = turn @ (place - lively.neck) + lively.neck - rest[point]
            seen += [placed[point] / PLACE, velocity[point] / STEP, pull / PULL, slid / PLACE]
        moved = torch.cat([omega / OMEGA, alpha / ALPHA, weight / PULL])
        hidden = lively.of_points(torch.cat(seen)) + lies + lively.of_head(moved)
        gained = (lively.gain(silu(lively.middle(silu(hidden)))) - at_rest).view(-1, 3)
        kept = 1 - torch.sigmoid(lively.loss_logit)
        after = (1 - FORGOTTEN) * placed + kept * velocity + STEP * lively.freedom * gained
        after = torch.minimum(torch.maximum(after, -2 * from_root), 2 * from_root)
        velocity, placed = after - placed, after
        said.append(placed)
    return torch.stack(said)


def test_a_motion_can_be_taken_up_in_any_frame() -> None:
    lively, rest, head = network(by=0.2), strands(), motions()
    with torch.no_grad():
        whole = lively(rest, head)
        start = StrandStates(whole[:, 20], whole[:, 20] - whole[:, 19])
        again = lively(rest, HeadMotions(*(part[:, 20:] for part in head)), start)
    torch.testing.assert_close(again, whole[:, 20:], rtol=1e-9, atol=1e-12)


def test_shorter_frames_come_closer_to_one_motion() -> None:
    """Halving the frames halves what the next halving changes, as of a semi-implicit step it must."""
    lively, rest = network(by=0.1), strands()

    def after_a_second(pace: float) -> torch.Tensor:
        times = torch.arange(round(FPS / pace) + 1, dtype=torch.float64) * pace / FPS
        signals = [
            size * (rate * times[:, None] + torch.arange(3)).sin().expand(2, -1, -1) * times[:, None]
            for size, rate in ((3, 4.0), (20, 5.0), (0.4, 3.0), (4, 6.0))
        ]
        with torch.no_grad():
            return lively(rest, HeadMotions(*signals), pace=pace)[:, -1]

    coarse, fine, finer = (after_a_second(pace) for pace in (0.5, 0.25, 0.125))
    first, second = (fine - coarse).norm(), (finer - fine).norm()
    assert finer.norm() > 5 * first
    assert 0.35 < second / first < 0.65


@settings(max_examples=20)
@given(st.integers(0, 1000), st.floats(0, 3))
def test_hair_at_rest_stays_there_whatever_is_learned(seed: int, by: float) -> None:
    still = HeadMotions(*[torch.zeros(2, FRAMES, 3, dtype=torch.float64)] * 4)
    assert network(seed, by)(strands(), still).abs().max() < 1e-9


@settings(max_examples=20)
@given(st.integers(0, 1000), st.floats(0, 3))
def test_hair_stays_bounded_whatever_is_learned(seed: int, by: float) -> None:
    rest = strands()
    moved = network(seed, by)(rest, motions(frames=300, size=5))
    longest = strand_lengths(rest.flatten(0, 1)).max()
    assert moved.isfinite().all()
    assert moved.abs().max() <= 2 * longest * (1 + 1e-9)
    assert not moved[:, :, :, 0].any()  # roots stay in the scalp


def test_gradients_are_those_of_finite_differences() -> None:
    lively, rest, head = network(by=0.1), strands(1, 2), motions(1, 6)
    parameters = [lively.neck, lively.gain.weight, lively.loss_logit, lively.of_rest.weight]
    lively(rest, head).square().sum().backward()
    for parameter in parameters:
        flat, gradient = parameter.data.view(-1), parameter.grad
        assert gradient is not None
        for index in torch.randperm(flat.numel())[:3].tolist():
            values = []
            for step in (1e-5, -1e-5):
                flat[index] += step
                values.append(lively(rest, head).square().sum().item())
                flat[index] -= step
            expected = (values[0] - values[1]) / 2e-5
            assert abs(float(gradient.view(-1)[index]) - expected) < 1e-5 * max(1.0, abs(expected))


def hanging() -> torch.Tensor:
    """Strands of twenty to forty centimetres, all around a head of which the roots' mean is the origin."""
    angles = torch.linspace(0, 2 * torch.pi, 13)[:-1]
    roots = 0.09 * torch.stack([angles.cos(), torch.zeros(12), angles.sin()], 1)
    along = torch.linspace(0, 1, POINTS)[None, :, None] * torch.linspace(0.2, 0.4, 12)[:, None, None]
    return (roots[:, None] * (1 + along) - along * torch.tensor([0.0, 1.0, 0.0]))[None]


@torch.no_grad()
def test_taught_hair_lags_behind_a_head_that_turns_and_settles_when_it_halts() -> None:
    taught, rest = StrandDynamics.taught(), hanging()
    frames, turning = 150, 12
    turn, omega, alpha = (torch.zeros(1, frames, 3) for _ in range(3))
    turn[0, :, 1] = torch.cat([torch.linspace(0, 0.6, turning), torch.full((frames - turning,), 0.6)])
    omega[0, :-1, 1] = turn[0, :, 1].diff() * FPS
    alpha[0, 1:, 1] = omega[0, :, 1].diff() * FPS
    moved = taught(rest, HeadMotions(omega, alpha, turn, torch.zeros_like(turn)))[0]
    tips = moved[:, :, -1]
    # seen from the head, what stays behind turns the other way
    backwards = torch.linalg.cross(torch.tensor([0.0, -1.0, 0.0]).expand(12, 3), rest[0, :, -1])
    assert (tips[turning] * backwards).sum(-1).min() > 0
    speeds = moved.diff(dim=0).norm(dim=-1).mean((1, 2)) * FPS
    assert speeds[-30:].max() < 0.1 * speeds[: 2 * turning].max()
