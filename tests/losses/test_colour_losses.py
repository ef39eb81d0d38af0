"""Colour regularisation against the paper's sums in loops, and neighbours against all distances."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.losses import colour_consistency_loss, colour_gradient_loss, colour_neighbours, colour_spatial_loss


def random_means(strands: int = 7, length: int = 5, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(strands, length, 3, generator=generator, dtype=torch.float64).cumsum(dim=1)


def random_colours(strands: int = 7, length: int = 5, seed: int = 1) -> torch.Tensor:
    return torch.rand(3, strands, length, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


NEIGHBOURS = colour_neighbours(random_means(), 4)

LOSSES: list[Callable[[torch.Tensor], torch.Tensor]] = [
    colour_gradient_loss,
    colour_consistency_loss,
    lambda colours: colour_spatial_loss(colours, NEIGHBOURS),
]


def test_gradient_agrees_with_a_loop() -> None:
    colours = random_colours().permute(1, 2, 0).numpy()
    total = sum(((strand[j + 1] - strand[j]) ** 2).sum() for strand in colours for j in range(4))
    assert colour_gradient_loss(random_colours()).item() == pytest.approx(total / (7 * 5))


def test_consistency_agrees_with_a_loop() -> None:
    colours = random_colours().permute(1, 2, 0).tolist()
    total = 0.0
    for strand in colours:
        mean = [sum(colour[channel] for colour in strand) / 5 for channel in range(3)]
        total += sum((colour[channel] - mean[channel]) ** 2 for colour in strand for channel in range(3))
    assert colour_consistency_loss(random_colours()).item() == pytest.approx(total / (7 * 5))


def test_spatial_agrees_with_a_loop() -> None:
    colours = random_colours().permute(1, 2, 0).reshape(-1, 3).numpy()
    pairs = [(a, b) for a, row in enumerate(NEIGHBOURS.tolist()) for b in row]
    total = sum(((colours[a] - colours[b]) ** 2).sum() for a, b in pairs)
    assert len(pairs) == 7 * 5 * 4
    assert colour_spatial_loss(random_colours(), NEIGHBOURS).item() == pytest.approx(total / len(pairs))


@pytest.mark.parametrize("parts", [2, 3, 8, 35, 40])
def test_the_mean_over_parts_is_the_whole_with_its_gradients(parts: int) -> None:
    colours = random_colours().requires_grad_()
    whole = colour_spatial_loss(colours, NEIGHBOURS)
    shares = [colour_spatial_loss(colours, NEIGHBOURS, part=part, parts=parts) for part in range(parts)]
    mean = torch.stack(shares).mean()
    torch.testing.assert_close(mean, whole)
    torch.testing.assert_close(torch.autograd.grad(mean, colours), torch.autograd.grad(whole, colours))
    assert len({share.item() for share in shares}) > 1


@pytest.mark.parametrize("loss", LOSSES)
def test_gradients_agree_with_finite_differences(loss: Callable[[torch.Tensor], torch.Tensor]) -> None:
    assert torch.autograd.gradcheck(loss, random_colours().requires_grad_())


@pytest.mark.parametrize("loss", LOSSES)
def test_one_colour_for_all_costs_nothing(loss: Callable[[torch.Tensor], torch.Tensor]) -> None:
    assert loss(torch.tensor([0.2, 0.5, 0.9])[:, None, None].expand(3, 7, 5)).item() == pytest.approx(0, abs=1e-12)


def test_strands_of_one_colour_each_cost_their_neighbours_alone() -> None:
    colours = torch.rand(3, 7, 1).expand(3, 7, 5)
    assert colour_gradient_loss(colours).item() == 0
    assert colour_consistency_loss(colours).item() == pytest.approx(0, abs=1e-12)
    assert colour_spatial_loss(colours, NEIGHBOURS).item() > 0.01


@pytest.mark.parametrize("shape", [(3, 4, 1), (3, 0, 5)])
def test_strands_of_one_gaussian_and_no_strands_at_all_cost_nothing(shape: tuple[int, int, int]) -> None:
    colours = torch.rand(shape, requires_grad=True)
    loss = colour_gradient_loss(colours) + colour_consistency_loss(colours)
    loss.backward()
    assert loss.item() == 0
    assert colours.grad is not None
    assert torch.equal(colours.grad, torch.zeros(shape))


@given(st.integers(2, 9), st.integers(1, 12), st.integers(1, 8), st.integers(0, 1000))
def test_neighbours_are_the_nearest_of_all_on_other_strands(strands: int, length: int, k: int, seed: int) -> None:
    means = random_means(strands, length, seed)
    k = min(k, (strands - 1) * length)
    found = colour_neighbours(means, k).numpy()
    points = means.reshape(-1, 3).numpy()
    for index, row in enumerate(found):
        distances = [
            np.inf if other // length == index // length else float(np.linalg.norm(points[other] - points[index]))
            for other in range(len(points))
        ]
        assert len(set(row)) == k
        assert [distances[other] for other in row] == pytest.approx(sorted(distances)[:k])


def test_a_strand_that_is_far_from_all_others_finds_them_past_its_own_gaussians() -> None:
    means = torch.zeros(3, 40, 3)
    means[:, :, 1] = -torch.arange(40.0) / 1000
    means[2, :, 0] = 50.0
    found = colour_neighbours(means, 8)
    assert (found[80:] < 80).all()
    assert (found[:40] // 40 == 1).all()


@pytest.mark.parametrize(
    ("strands", "length", "k"), [(3, 5, 0), (3, 5, -1), (3, 5, 11), (1, 5, 1), (0, 5, 8), (3, 0, 8)]
)
def test_more_neighbours_than_there_are_get_an_error(strands: int, length: int, k: int) -> None:
    with pytest.raises(DynhairError, match=f"cannot find {k} neighbours"):
        colour_neighbours(torch.zeros(strands, length, 3), k)


def test_strands_that_are_not_finite_get_an_error() -> None:
    with pytest.raises(DynhairError, match="not finite"):
        colour_neighbours(torch.full((3, 4, 3), torch.nan), 2)
