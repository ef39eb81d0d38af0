"""The dynamics term, against motions that obey it and against its formula written out."""

from __future__ import annotations

import math

import torch

from dynhair.losses import HairSprings, dynamics_loss
from dynhair.losses.dynamics import FIXED, GRAVITY, KNEE
from dynhair.motion import HeadForces

FPS = 30.0
STILL = HeadForces(torch.zeros(3), torch.zeros(3), torch.tensor([0.0, -GRAVITY, 0.0]))


def hanging(strands: int = 4, points: int = 12) -> torch.Tensor:
    """Straight strands of 33 cm."""
    rest = torch.zeros(strands, points, 3)
    rest[..., 1] = -0.03 * torch.arange(points)
    rest[..., 0] = 0.1 * torch.arange(strands)[:, None]
    return rest


def lively(springs: HairSprings) -> HairSprings:
    generator = torch.Generator().manual_seed(3)
    with torch.no_grad():
        for parameter in springs.parameters():
            parameter.add_(0.2 * torch.randn(parameter.shape, generator=generator))
    return springs


@torch.no_grad()
def written_out(moved, rest, springs, forces, pull_at_rest) -> torch.Tensor:
    """The docstring's formula, point by point, in double precision."""
    damping, bending = float(springs.log_damping.exp()), float(springs.log_bending.exp())
    stiffness = springs.log_stiffness.exp().double()
    before, now, after = moved.double()
    _, strands, points, _ = moved.shape
    sizes = []
    for i in range(strands):
        for j in range(FIXED, points):
            d = (now - rest.double())[i]
            velocity = (after[i, j] - before[i, j]) * FPS / 2
            acceleration = (after[i, j] - 2 * now[i, j] + before[i, j]) * FPS**2
            beyond = d[j + 1] - d[j] if j + 1 < points else torch.zeros(3, dtype=torch.float64)
            bent = (beyond - (d[j] - d[j - 1])) * (points - 1) ** 2
            omega, alpha, pull = (part.double() for part in forces)
            x = now[i, j]
            free = pull - alpha.cross(x, 0) - omega.cross(omega.cross(x, 0), 0) - 2 * omega.cross(velocity, 0)
            r = acceleration + damping * velocity + stiffness[j] * d[j] - bending * bent
            r = (r - (free - pull_at_rest.double())) / GRAVITY
            tangent = (now[i, j] - now[i, j - 1]) / (now[i, j] - now[i, j - 1]).norm()
            size = float((r - (r @ tangent) * tangent).norm())
            sizes.append(size**2 / (2 * KNEE) if size < KNEE else size - KNEE / 2)
    return torch.tensor(sum(sizes) / len(sizes))


def test_is_the_formula():
    generator = torch.Generator().manual_seed(0)
    rest = hanging()
    springs = lively(HairSprings(rest))
    steps = torch.tensor([0.004, 0.0, 0.006])[:, None, None, None]
    moved = rest + 0.01 * torch.randn(rest.shape, generator=generator)
    moved = moved + steps * torch.randn(rest.shape, generator=generator)
    forces = HeadForces(*(torch.randn(3, generator=generator) * scale for scale in (3.0, 20.0, 9.0)))
    found = dynamics_loss(moved, rest, springs, forces, STILL.pull, FPS)
    expected = written_out(moved, rest, springs, forces, STILL.pull).float()
    torch.testing.assert_close(found.detach(), expected, rtol=1e-4, atol=0.0)


def test_hair_at_rest_in_a_still_head_costs_nothing():
    rest = hanging()
    assert dynamics_loss(rest.expand(3, -1, -1, -1), rest, HairSprings(rest), STILL, STILL.pull, FPS) == 0


def test_a_damped_swing_costs_next_to_nothing_and_another_rhythm_much():
    """A pendulum's small swing sideways, of the frequency and the damping that the springs have."""
    rest = hanging()
    springs = HairSprings(rest)
    fps = 1000.0  # differences become derivatives
    stiffness, damping = 40.0, 3.0
    with torch.no_grad():
        springs.log_stiffness.fill_(math.log(stiffness))
        springs.log_damping.fill_(math.log(damping))
        springs.log_bending.fill_(-30.0)
    shape = torch.linspace(0, 0.05, rest.shape[1])

    def swing(time: float, frequency: float) -> torch.Tensor:
        moved = rest.clone().double()
        moved[..., 0] += shape.double() * math.exp(-damping / 2 * time) * math.cos(frequency * time)
        return moved

    def cost(frequency: float) -> float:
        moved = torch.stack([swing(0.1 + step / fps, frequency) for step in (-1, 0, 1)])
        double = springs.double()
        forces = HeadForces(*(part.double() for part in STILL))
        return float(dynamics_loss(moved, rest.double(), double, forces, forces.pull, fps).detach())

    own = math.sqrt(stiffness - damping**2 / 4)
    assert cost(own) < 1e-6
    assert cost(2 * own) > 0.01


def test_what_stretches_alone_is_left_to_elasticity():
    rest = hanging()
    moved = rest.repeat(3, 1, 1, 1)
    moved[2, :, FIXED:, 1] -= 0.01  # along the strand
    assert dynamics_loss(moved, rest, HairSprings(rest), STILL, STILL.pull, FPS) < 1e-6


def test_springs_begin_as_pendulums():
    springs = HairSprings(hanging())
    torch.testing.assert_close(springs.log_stiffness.exp()[-1], torch.tensor(GRAVITY / 0.33))
    assert (springs.log_stiffness.diff() <= 0).all()


def test_gradients_are_autograds_in_double_precision():
    generator = torch.Generator().manual_seed(1)
    rest = hanging(2, 6).double()
    springs = lively(HairSprings(rest).double())
    moved = (rest + 0.01 * torch.randn(3, *rest.shape, generator=generator, dtype=torch.float64)).requires_grad_()
    forces = HeadForces(*(torch.randn(3, generator=generator, dtype=torch.float64) for _ in range(3)))
    loss = dynamics_loss(moved, rest, springs, forces, STILL.pull.double(), FPS)
    loss.backward()
    # before and after carry no held parts, so that finite differences see the whole derivative there
    step = 1e-6
    for place in [(0, 0, 4, 0), (2, 1, 5, 2), (0, 1, 3, 1)]:
        values = []
        for sign in (1, -1):
            other = moved.detach().clone()
            other[place] += sign * step
            values.append(float(dynamics_loss(other, rest, springs, forces, STILL.pull.double(), FPS).detach()))
        assert moved.grad is not None
        torch.testing.assert_close(float(moved.grad[place]), (values[0] - values[1]) / (2 * step), rtol=1e-4, atol=1e-7)
    for parameter in springs.parameters():
        assert parameter.grad is not None
        assert parameter.grad.abs().sum() > 0


def test_a_single_frame_of_unmoved_hair_has_finite_gradients():
    rest = hanging()
    moved = rest.repeat(3, 1, 1, 1).requires_grad_()
    dynamics_loss(moved, rest, HairSprings(rest), STILL, STILL.pull, FPS).backward()
    assert moved.grad is not None
    assert moved.grad.isfinite().all()
