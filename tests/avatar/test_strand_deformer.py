"""Hair that moves by dynamics of strands: guides, what follows them, and motions drawn frame by frame."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dynhair.avatar import StrandDeformer, strand_deformer
from dynhair.avatar.strand_dynamics import FPS, POINTS, HeadMotions, RestingStrands, StrandStates
from dynhair.avatar.strand_memory import StrandMemory
from dynhair.config import DeformerConfig
from dynhair.motion import GRAVITY, motion_window
from dynhair.strands import resample_strands

GRADED = round(strand_deformer.GRADED * FPS)
CONFIG = DeformerConfig(kind="strands", history=15, guides=6, turn=True)


def canonical(strands: int = 20, points: int = POINTS) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    roots = 0.1 * torch.nn.functional.normalize(torch.randn(strands, 3, generator=generator), dim=1)
    down = torch.linspace(0, 0.3, points)[:, None] * torch.tensor([0.1, -1.0, 0.0])
    return roots[:, None] + down


def conditions(frames: int = 60, seed: int = 1) -> torch.Tensor:
    """Of a motion that begins at rest."""
    generator = torch.Generator().manual_seed(seed)
    swings = (0.2 * torch.randn(frames, 12, generator=generator)).cumsum(0).sin()
    size = torch.tensor([2.0, 10.0, 0.3, 0.4]).repeat_interleave(3)
    return swings * size * torch.linspace(0, 1, frames)[:, None]


@torch.no_grad()
def test_each_guide_moves_as_dynamics_say() -> None:
    """With as many guides as strands, each of which follows itself alone but for its neighbours' small shares."""
    hair = canonical()
    deformer = StrandDeformer(hair, replace(CONFIG, guides=20))
    window = conditions(10)
    states = deformer.states(deformer.begun(window))
    omega, alpha, pull, turn = window[None].split(3, -1)
    head = deformer._head(window)
    assert torch.equal(head.omega, omega)
    assert torch.equal(head.alpha, alpha)
    assert torch.equal(head.turn, turn)
    torch.testing.assert_close(head.weight, GRAVITY * pull)
    moved = deformer.dynamics(deformer.guides[None], head)
    torch.testing.assert_close(states.placed, moved[:, -1])
    torch.testing.assert_close(states.velocity, moved[:, -1] - moved[:, -2])
    spread = deformer.guides.flatten(1)
    order = torch.cdist(resample_strands(hair, POINTS).flatten(1), spread).argmin(1)
    torch.testing.assert_close(deformer.following(states), moved[0, -1, order], rtol=0, atol=2e-3)


@torch.no_grad()
def test_hair_swings_as_fast_in_frames_of_any_length() -> None:
    hair, second = canonical(), conditions(31)
    times = torch.linspace(0, 1, 61)
    between = torch.lerp(second[(30 * times).long()], second[(30 * times).ceil().long()], (30 * times[:, None]) % 1)
    moved, sooner, unaware = (
        StrandDeformer(hair, replace(CONFIG, history=60), fps)(window)
        for fps, window in ((30.0, second), (60.0, between), (30.0, between))
    )
    assert (sooner - moved).norm() < 0.5 * (unaware - moved).norm()


@torch.no_grad()
def test_a_strand_moves_within_what_its_guides_do() -> None:
    deformer = StrandDeformer(canonical(points=25), CONFIG)
    states = deformer.states(conditions(12))
    moved = deformer(conditions(12))
    low, high = states.placed[0].amin(0), states.placed[0].amax(0)
    assert moved.shape == (20, 25, 3)
    assert (deformer.following(states) >= low - 1e-6).all()
    assert (deformer.following(states) <= high + 1e-6).all()
    torch.testing.assert_close(moved[:, [0, -1]], deformer.following(states)[:, [0, -1]])


@torch.no_grad()
def test_before_a_motion_the_head_holds_still() -> None:
    deformer, motion = StrandDeformer(canonical(), CONFIG), conditions()
    # frames before the first repeat it; at rest they are nothing
    torch.testing.assert_close(deformer(motion_window(motion, 9, 15)), deformer(motion[:10]))
    assert deformer(torch.zeros(16, 12)).abs().max() < 1e-6
    # a head that was held tilted before has hair that hangs, whatever its velocity is from then on
    tilted = motion.clone()
    tilted[0, 9:] = 0.3
    spinning = tilted.clone()
    spinning[0, :6] = 2.0
    hanging, before = (deformer(motion_window(each, 0, 15)) for each in (tilted, spinning))
    assert hanging.abs().max() > 1e-3
    torch.testing.assert_close(hanging, before)


@pytest.mark.parametrize("frames", [2, GRADED, GRADED + 1, GRADED + 20])
def test_gradients_go_back_so_many_frames(frames: int) -> None:
    deformer, window = StrandDeformer(canonical(), CONFIG), conditions(frames)
    aim = 0.02 * torch.randn(20, POINTS, 3, generator=torch.Generator().manual_seed(5))

    def displaced(states: StrandStates) -> torch.Tensor:
        return torch.einsum("lk,nkc->nlc", deformer.along, deformer.following(states))

    def gradient(moved: torch.Tensor) -> torch.Tensor:
        return torch.autograd.grad((moved - aim).square().sum(), deformer.dynamics.of_points.weight)[0]

    begun = deformer.begun(window)
    early = max(len(begun) - GRADED, 1)
    with torch.no_grad():
        start = deformer.states(begun[:early])
    moved, whole = deformer(window), displaced(deformer.states(begun))
    torch.testing.assert_close(moved, whole, rtol=1e-4, atol=1e-6)
    found, through_all = gradient(moved), gradient(whole)
    torch.testing.assert_close(found, gradient(displaced(deformer.states(begun[early - 1 :], start))))
    assert torch.allclose(found, through_all, rtol=1e-3, atol=1e-6) == (len(begun) <= GRADED + 1)


@torch.no_grad()
@pytest.mark.parametrize("change", [{"acceleration": False}, {"gravity": False}, {"turn": False}, {"taught": False}])
def test_parts_can_be_left_out(change: dict[str, bool]) -> None:
    config = replace(CONFIG, **change)  # pyright: ignore[reportArgumentType]
    deformer = StrandDeformer(canonical(), config)
    seen = 12 - 3 * sum(name != "taught" for name in change)
    moved = deformer(conditions(12)[:, :seen])
    whole = StrandDeformer(canonical(), CONFIG)(conditions(12))
    assert moved.isfinite().all()
    assert (moved - whole).abs().max() > 1e-4


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 59), st.integers(0, 9)), min_size=1, max_size=6), st.booleans())
@torch.no_grad()
def test_a_motion_drawn_frame_by_frame_is_the_motion_unrolled(runs: list[tuple[int, int]], whole: bool) -> None:
    """Runs of frames from anywhere: in each, windows that reach back to the motion's beginning give the same."""
    history = 60 if whole else 15
    deformer, motion = StrandDeformer(canonical(), CONFIG), conditions()
    memory = StrandMemory(deformer)
    for first, length in runs:
        for frame in range(first, min(first + length, 60)):
            window = motion_window(motion, frame, history)
            placed, expected = memory.states(window).placed, deformer.states(deformer.begun(window)).placed
            if whole or frame < history:
                torch.testing.assert_close(placed, expected, rtol=1e-4, atol=1e-6)
            elif frame == first:  # it may go on from a run before, and then remembers more than the window
                remembered = deformer.states(deformer.begun(motion[: frame + 1])).placed
                nearest = min((placed - each).abs().max() for each in (expected, remembered))
                assert nearest < (expected - remembered).abs().max() + 1e-5


@torch.no_grad()
def test_played_in_order_hair_remembers_more_than_a_window() -> None:
    deformer, motion = StrandDeformer(canonical(), CONFIG), conditions()
    memory = StrandMemory(deformer)
    played = [memory.states(motion_window(motion, frame, 15)).placed for frame in range(60)]
    torch.testing.assert_close(played[-1], deformer.states(deformer.begun(motion)).placed, rtol=1e-4, atol=1e-6)


@torch.no_grad()
def test_provisional_ends_of_a_live_motion_are_taken_back() -> None:
    deformer, motion = StrandDeformer(canonical(), CONFIG), conditions()
    memory, steps = StrandMemory(deformer), []
    real = deformer.dynamics.moved

    def counted(guides: RestingStrands, head: HeadMotions, *others: object, **named: object) -> torch.Tensor:
        steps.append(head[0].shape[1] - 1)
        return real(guides, head, *others, **named)  # pyright: ignore[reportArgumentType]

    deformer.dynamics.moved = counted  # pyright: ignore[reportAttributeAccessIssue]
    for frame in range(2, 14):
        seen = motion[: frame + 1].clone()
        seen[-2:] *= 1.1
        window = motion_window(seen, frame, 15)
        before = sum(steps)
        placed = memory.states(window).placed
        spent = sum(steps) - before
        torch.testing.assert_close(placed, deformer.states(deformer.begun(window)).placed, rtol=1e-4, atol=1e-6)
        if frame > 2:
            assert spent <= 3  # one frame more, and two that may change again


def test_hair_that_does_not_come_back_is_told_from_hair_that_does() -> None:
    """Strands that gain nothing at rest stay where a motion has left them; a spring brings them back."""
    deformer = StrandDeformer(canonical(), replace(CONFIG, taught=False))
    dynamics = deformer.dynamics
    motion = conditions(40)
    for parameter in (dynamics.gain.weight, dynamics.of_points.weight, dynamics.middle.weight):
        torch.nn.init.zeros_(parameter)
    with torch.no_grad():
        dynamics.of_head.weight.normal_(std=0.5, generator=torch.Generator().manual_seed(0))
        dynamics.middle.weight.copy_(torch.eye(256))
        dynamics.gain.weight.normal_(std=0.05, generator=torch.Generator().manual_seed(1))
        left = deformer.states(deformer.begun(motion)).placed.norm(dim=-1).mean()
    lost = deformer.unsettled(motion, 6, torch.Generator().manual_seed(0))
    assert left > 0.005
    assert lost > 0.25 * left  # some of it is forgotten
    few = deformer.unsettled(motion, 3, torch.Generator().manual_seed(0))
    assert few != lost
    assert torch.equal(few, deformer.unsettled(motion, 3, torch.Generator().manual_seed(0)))
    # a small step along the gradient brings them closer
    deformer.zero_grad()
    lost.backward()
    assert dynamics.of_points.weight.grad is not None
    with torch.no_grad():
        dynamics.of_points.weight.sub_(1e-3 * torch.nn.functional.normalize(dynamics.of_points.weight.grad))
    assert deformer.unsettled(motion, 6, torch.Generator().manual_seed(0)) < lost
