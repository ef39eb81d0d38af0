"""Strand geometry against plain loops, closed forms and autograd checks."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.strands import (
    bending_angles,
    cut_strands,
    resample_strands,
    segment_lengths,
    smooth_strands,
    strand_lengths,
    with_lengths,
)


def random_strands(count: int = 6, points: int = 9, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    steps = torch.randn(count, points, 3, generator=generator, dtype=torch.float64)
    return (0.01 * steps + torch.tensor([0.0, -0.01, 0.0])).cumsum(dim=1)


def helix(points: int, turns: float = 1.5) -> torch.Tensor:
    angle = torch.linspace(0, 2 * torch.pi * turns, points, dtype=torch.float64)
    return torch.stack([angle.cos(), 0.2 * angle, angle.sin()], dim=-1)[None]


def test_lengths_and_angles_agree_with_loops() -> None:
    strands = random_strands()
    for strand, lengths, total, angles in zip(
        strands.numpy(), segment_lengths(strands), strand_lengths(strands), bending_angles(strands), strict=True
    ):
        edges = np.diff(strand, axis=0)
        norms = np.linalg.norm(edges, axis=1)
        np.testing.assert_allclose(lengths, norms)
        assert total == pytest.approx(norms.sum())
        cosines = [a @ b / (m * n) for a, b, m, n in zip(edges[:-1], edges[1:], norms[:-1], norms[1:], strict=True)]
        np.testing.assert_allclose(angles, np.arccos(cosines), atol=1e-9)


def test_bending_angles_of_straight_and_folded_strands() -> None:
    straight = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0]]], requires_grad=True)
    angles = bending_angles(straight)
    torch.testing.assert_close(angles, torch.tensor([[0.0, torch.pi]]))
    angles.sum().backward()
    assert straight.grad is not None
    assert straight.grad.isfinite().all()


def test_gradients_are_finite_without_length() -> None:
    strands = torch.zeros(2, 6, 3, requires_grad=True)
    resampled = resample_strands(strands, 9)
    total = bending_angles(strands).sum() + strand_lengths(strands).sum() + resampled.sum()
    total = total + with_lengths(strands, strands).sum()
    total.backward()
    assert torch.equal(resampled, torch.zeros(2, 9, 3))
    assert strands.grad is not None
    assert strands.grad.isfinite().all()


def test_gradients_agree_with_finite_differences() -> None:
    strands = random_strands(count=2, points=5).requires_grad_()
    assert torch.autograd.gradcheck(bending_angles, strands)
    assert torch.autograd.gradcheck(strand_lengths, strands)
    assert torch.autograd.gradcheck(lambda s: resample_strands(s, 7), strands)
    assert torch.autograd.gradcheck(smooth_strands, strands)
    rest = random_strands(count=2, points=5, seed=1).requires_grad_()
    assert torch.autograd.gradcheck(with_lengths, (strands, rest))


@pytest.mark.parametrize("count", [2, 5, 9, 40])
def test_resampling_agrees_with_interpolation_along_the_arc(count: int) -> None:
    strands = random_strands()
    resampled = resample_strands(strands, count)
    for strand, found in zip(strands.numpy(), resampled.numpy(), strict=True):
        along = np.concatenate([[0], np.linalg.norm(np.diff(strand, axis=0), axis=1).cumsum()])
        steps = np.linspace(0, along[-1], count)
        expected = np.stack([np.interp(steps, along, strand[:, axis]) for axis in range(3)], axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-12)


@given(st.integers(0, 10_000), st.integers(2, 60))
def test_resampling_keeps_ends_exactly_and_never_lengthens(seed: int, count: int) -> None:
    strands = random_strands(seed=seed).float()
    resampled = resample_strands(strands, count)
    assert torch.equal(resampled[:, 0], strands[:, 0])
    assert torch.equal(resampled[:, -1], strands[:, -1])
    assert (strand_lengths(resampled) <= strand_lengths(strands) * (1 + 1e-5)).all()


def test_resampling_a_curve_finely_keeps_its_length() -> None:
    curve = helix(200)
    torch.testing.assert_close(strand_lengths(resample_strands(curve, 100)), strand_lengths(curve), rtol=1e-3, atol=0)
    lengths = segment_lengths(resample_strands(curve, 50))
    assert lengths.max() / lengths.min() < 1.001


def test_resampling_crosses_repeated_points() -> None:
    strand = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [3, 0, 0]]])
    torch.testing.assert_close(resample_strands(strand, 4)[0, :, 0], torch.tensor([0.0, 1, 2, 3]))


def test_resampling_to_one_point_is_refused() -> None:
    with pytest.raises(DynhairError, match="1 points"):
        resample_strands(helix(5), 1)


@given(st.integers(0, 1000), st.floats(0.1, 10.0))
def test_given_lengths_change_neither_directions_nor_roots(seed: int, size: float) -> None:
    strands, rest = size * random_strands(seed=seed), random_strands(seed=seed + 1)
    bent = with_lengths(strands, rest)
    assert torch.equal(bent[:, 0], rest[:, 0])
    torch.testing.assert_close(segment_lengths(bent), segment_lengths(rest))
    directions = [torch.nn.functional.normalize(some.diff(dim=1), dim=-1) for some in (bent, strands)]
    torch.testing.assert_close(*directions)
    torch.testing.assert_close(with_lengths(rest, rest), rest)


def test_smoothing_averages_three_points_and_keeps_the_ends() -> None:
    strands = random_strands()
    smooth = smooth_strands(strands)
    assert torch.equal(smooth[:, [0, -1]], strands[:, [0, -1]])
    for j in range(1, strands.shape[1] - 1):
        torch.testing.assert_close(smooth[:, j], strands[:, j - 1 : j + 2].mean(dim=1))


def test_smoothing_leaves_evenly_spaced_straight_strands_alone() -> None:
    straight = torch.linspace(0, 1, 8, dtype=torch.float64)[None, :, None] * torch.tensor([[[1.0, -2.0, 0.5]]])
    torch.testing.assert_close(smooth_strands(straight), straight)


def test_cutting_a_straight_strand() -> None:
    course = torch.tensor([[[0.0, 0, 0], [0, -0.3, 0], [0, -1.0, 0]]])
    expected = torch.tensor([0, -0.2, -0.4, -0.6])
    torch.testing.assert_close(cut_strands(course, torch.tensor([0.6]), 4)[0, :, 1], expected)


def test_a_strand_cut_at_its_whole_length_is_resampled() -> None:
    strands = torch.randn(5, 30, 3, generator=torch.Generator().manual_seed(0)).cumsum(1)
    whole = cut_strands(strands, strand_lengths(strands), 12)
    torch.testing.assert_close(whole, resample_strands(strands, 12), atol=1e-4, rtol=1e-4)
