"""Regularisers of the static stage against the paper's sums in loops."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from dynhair.losses import length_loss, shape_loss, smoothness_loss
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
