"""Regularisers of the static stage against the paper's sums in loops."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from dynhair.losses import grows_in_front, length_loss, pca_consistency_loss, shape_loss, smoothness_loss
from dynhair.strands import root_neighbours

LOSSES = [shape_loss, smoothness_loss, length_loss]


def hairstyle(count: int = 12, points: int = 6) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    steps = torch.randn(count, points, 3, generator=generator, dtype=torch.float64) + torch.tensor([0.0, -1.0, 0.0])
    strands = steps.cumsum(dim=1)
    return strands, root_neighbours(strands[:, 0], 4)


def edges(strand: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    steps = strand[1:] - strand[:-1]
    return steps, np.sqrt((steps**2).sum(axis=1))


def curvature(strand: np.ndarray) -> np.ndarray:
    steps, lengths = edges(strand)
    pairs = range(len(steps) - 1)
    return np.array([np.arccos(steps[m] @ steps[m + 1] / (lengths[m] * lengths[m + 1])) for m in pairs])


DESCRIPTORS: list[Callable[[np.ndarray], np.ndarray]] = [
    curvature,
    lambda strand: strand - strand[0],
    lambda strand: edges(strand)[1].sum(),
]


@pytest.mark.parametrize(("loss", "descriptor"), list(zip(LOSSES, DESCRIPTORS, strict=True)))
def test_losses_agree_with_loops(
    loss: Callable[[torch.Tensor, torch.Tensor], torch.Tensor], descriptor: Callable[[np.ndarray], np.ndarray]
) -> None:
    strands, neighbours = hairstyle()
    total = 0.0
    for i, others in enumerate(neighbours.tolist()):
        for j in others:
            total += ((descriptor(strands[i].numpy()) - descriptor(strands[j].numpy())) ** 2).sum()
    assert loss(strands, neighbours).item() == pytest.approx(total / (12 * 4))


@pytest.mark.parametrize("loss", LOSSES)
def test_gradients_agree_with_finite_differences(loss: Callable[[torch.Tensor, torch.Tensor], torch.Tensor]) -> None:
    strands, neighbours = hairstyle(count=6, points=4)
    assert torch.autograd.gradcheck(lambda s: loss(s, neighbours), strands.requires_grad_())


@pytest.mark.parametrize("loss", LOSSES)
def test_copies_of_one_strand_cost_nothing(loss: Callable[[torch.Tensor, torch.Tensor], torch.Tensor]) -> None:
    strands, neighbours = hairstyle()
    copies = strands[:1] + torch.arange(12, dtype=torch.float64)[:, None, None]
    assert loss(copies, neighbours).item() < 1e-12


@pytest.mark.parametrize("loss", LOSSES)
def test_straight_and_collapsed_strands_have_finite_gradients(
    loss: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
) -> None:
    strands = torch.zeros(3, 5, 3)
    strands[1:, :, 1] = -torch.arange(5.0)
    strands[2, -1] = torch.tensor([0.5, -3.0, 0.0])
    strands.requires_grad_()
    loss(strands, torch.tensor([[1, 2], [0, 2], [0, 1]])).backward()
    assert strands.grad is not None
    assert strands.grad.isfinite().all()


def coefficients(seed: int, strands: int, components: int = 5) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    spread = torch.linspace(3, 0.1, components, dtype=torch.float64)
    return seed + spread * torch.randn(strands, components, generator=generator, dtype=torch.float64)


def test_pca_consistency_agrees_with_a_loop() -> None:
    front, back = coefficients(0, 7).tolist(), coefficients(1, 4).tolist()
    total = 0.0
    for d in range(1, 6):
        means, variances = [], []
        for side in (front, back):
            values = [strand[d - 1] for strand in side]
            means.append(sum(values) / len(values))
            variances.append(sum((value - means[-1]) ** 2 for value in values) / len(values))
        total += math.exp(-0.05 * d) * (abs(means[0] - means[1]) + 0.5 * abs(variances[0] - variances[1]))
    assert pca_consistency_loss(coefficients(0, 7), coefficients(1, 4)).item() == pytest.approx(total / 5)


def test_pca_consistency_has_correct_gradients() -> None:
    front, back = coefficients(0, 7).requires_grad_(), coefficients(1, 4).requires_grad_()
    assert torch.autograd.gradcheck(pca_consistency_loss, (front, back))


def test_the_order_of_strands_and_which_side_is_which_do_not_matter() -> None:
    front, back = coefficients(2, 6), coefficients(3, 6)
    torch.testing.assert_close(pca_consistency_loss(front, back.flip(0)), pca_consistency_loss(back, front))
    assert pca_consistency_loss(front, front.flip(0)).item() < 1e-12


def test_early_components_weigh_more() -> None:
    none = torch.zeros(3, 5)
    first, last = (torch.eye(5)[component].repeat(3, 1) for component in (0, 4))
    assert pca_consistency_loss(first, none).item() == pytest.approx(math.exp(-0.05) / 5)
    assert pca_consistency_loss(last, none).item() == pytest.approx(math.exp(-0.25) / 5)


@pytest.mark.parametrize(("front", "back"), [(0, 3), (3, 0), (0, 0), (1, 1)])
def test_a_side_without_strands_costs_nothing_and_one_strand_has_no_variance(front: int, back: int) -> None:
    sides = coefficients(0, front).requires_grad_(), coefficients(1, back).requires_grad_()
    loss = pca_consistency_loss(*sides)
    loss.backward()
    assert (loss.item() == 0) == (not front or not back)
    assert all(side.grad is not None and side.grad.isfinite().all() for side in sides)


def test_strands_are_in_front_by_their_roots_and_the_centre_of_the_scalp() -> None:
    roots = torch.tensor([[0.1, 0.0, 0.03], [0.0, 0.2, -0.05], [0.0, 0.0, 0.019]])
    assert grows_in_front(roots, torch.tensor([9.0, 9.0, 0.02])).tolist() == [True, False, False]
