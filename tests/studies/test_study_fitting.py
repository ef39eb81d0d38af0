"""Deformers over whole motions against themselves frame by frame, and that they learn what can be learned."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from made_motions import hanging, made_motion
from scipy.spatial.transform import Rotation
from studies.hair_motion.fitting import ROWS, Row, fitted, score, thinned
from studies.hair_motion.whole_motions import modal_amplitudes, modal_shapes, paper_batch, turned

from dynhair.avatar import ModalDeformer, PaperDeformer
from dynhair.config import DeformerConfig
from dynhair.errors import DynhairError
from dynhair.motion import motion_window

SMALL = DeformerConfig(
    kind="modal", history=75, modes=5, position_frequencies=2, place_frequencies=2, width=16, hidden=12, knots=0
)


@pytest.mark.parametrize("knots", [0, 3])
def test_modes_over_a_whole_motion_are_those_of_each_frame(knots: int) -> None:
    torch.manual_seed(0)
    deformer = ModalDeformer(hanging(), replace(SMALL, knots=knots))
    conditions = torch.randn(2, 20, 9)
    found = torch.einsum("nlcr,mfr->mfnlc", modal_shapes(deformer), modal_amplitudes(deformer, conditions))
    for motion in range(2):
        for frame in (0, 1, 7, 19):
            expected = deformer(motion_window(conditions[motion], frame, 75))
            torch.testing.assert_close(found[motion, frame], expected, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("knots", [0, 3])
def test_the_papers_network_over_a_batch_is_that_of_each_window(knots: int) -> None:
    torch.manual_seed(0)
    deformer = PaperDeformer(hanging(), replace(SMALL, kind="paper", history=6, knots=knots))
    with torch.no_grad():
        for parameter in deformer.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    windows = torch.randn(3, 7, 9)
    expected = torch.stack([deformer(window) for window in windows])
    torch.testing.assert_close(paper_batch(deformer, windows), expected, rtol=1e-4, atol=1e-6)


def test_turned_segments_are_turned_as_scipy_turns_them() -> None:
    hair = hanging(2, 4).double()
    turns = torch.randn(3, 2, 4, 3, dtype=torch.float64)
    moved = hair + turned(turns, hair)
    segments = hair.diff(dim=1)
    rotations = Rotation.from_rotvec(turns[:, :, 1:].reshape(-1, 3).numpy())
    expected = rotations.apply(segments.expand(3, -1, -1, -1).reshape(-1, 3).numpy())
    torch.testing.assert_close(moved.diff(dim=2).reshape(-1, 3), torch.from_numpy(expected))
    torch.testing.assert_close(moved[:, :, 0], hair[:, 0].expand(3, -1, -1))


def test_turning_is_differentiable_where_nothing_turns() -> None:
    turns = torch.zeros(1, 2, 4, 3, requires_grad=True)
    turned(turns, hanging(2, 4)).square().sum().backward()
    assert turns.grad is not None
    assert turns.grad.isfinite().all()


@pytest.mark.slow
@pytest.mark.parametrize("row", [Row(SMALL), Row(SMALL, turns=True, torso=True, fixed=True, noise=0.01, mirror=True)])
def test_modes_learn_hair_that_swings_in_a_mode(row: Row) -> None:
    learned = [made_motion(name) for name in ("turn", "random1")]
    assert abs(score(fitted(row, learned, steps=0), learned)) < 0.15
    assert score(fitted(row, learned, steps=150), learned) > 0.4


def test_a_fit_can_be_repeated() -> None:
    row, learned = Row(replace(SMALL, kind="paper", history=3)), [made_motion("turn")]
    first, second = (fitted(row, learned, seed=4, steps=3)(learned[0]) for _ in range(2))
    torch.testing.assert_close(first, second, rtol=0, atol=0)
    assert not torch.equal(first, fitted(row, learned, seed=5, steps=3)(learned[0]))


@pytest.mark.parametrize("row", [Row(replace(SMALL, inextensible=True)), Row(SMALL, turns=True, mirror=True)])
def test_strands_that_only_bend_keep_their_lengths(row: Row) -> None:
    motion = made_motion("turn")
    moved = motion.canonical + fitted(row, [motion], steps=2)(motion)
    lengths = motion.canonical.diff(dim=1).norm(dim=-1)
    torch.testing.assert_close(moved.diff(dim=2).norm(dim=-1), lengths.expand(75, -1, -1), rtol=1e-4, atol=1e-6)
    assert (moved - motion.canonical).norm(dim=-1).max() > 1e-5


def test_strands_are_thinned_in_step() -> None:
    motion = made_motion("turn")
    few = thinned(motion, 4)
    torch.testing.assert_close(few.canonical, motion.canonical[[0, 4]])
    torch.testing.assert_close(few.displacements, motion.displacements[:, [0, 4]])


def test_nothing_is_learned_from_nothing() -> None:
    with pytest.raises(DynhairError, match="no motion to learn from"):
        fitted(ROWS["24 modes"], [])
