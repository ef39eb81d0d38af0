"""Sums of absolute differences: compiled code against the plain formula in float64."""

from __future__ import annotations

import pytest
import torch

from dynhair.losses.differences import added_up


@pytest.mark.parametrize("size", [1, 15, 1024, 5003])
@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("threads", [1, 3])
def test_the_compiled_sum_and_gradient_are_those_of_the_plain_formula(
    size: int, turns: bool, weighted: bool, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynhair.threads.thread_count", lambda: threads)
    generator = torch.Generator().manual_seed(size)
    predicted, target, weight = torch.rand(3, size, generator=generator)
    predicted[:1] = target[:1]  # equal: no gradient in either
    found = []
    for dtype in (torch.float32, torch.float64):
        x, y = predicted.to(dtype, copy=True).requires_grad_(), target.to(dtype)
        w = weight.to(dtype) if weighted else None
        total = added_up(x, y, above=0.5, below=2.0, weight=w, turns=turns)
        (3 * total).backward()
        assert x.grad is not None
        found.append((total.detach().double(), x.grad.double()))
    torch.testing.assert_close(found[0], found[1], rtol=1e-6, atol=1e-6)
    assert not found[0][1][0]


def test_angles_are_compared_around_the_turn() -> None:
    angle = torch.tensor([0.95]).requires_grad_()
    total = added_up(angle, torch.tensor([0.05]), turns=True)
    total.backward()
    assert total.item() == pytest.approx(0.1, abs=1e-6)
    assert angle.grad is not None
    assert angle.grad.tolist() == [-1.0]


def test_the_plain_formula_has_the_gradient_of_finite_differences() -> None:
    generator = torch.Generator().manual_seed(0)
    x, y, w = torch.rand(3, 4, 5, generator=generator, dtype=torch.float64)

    def total(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        return added_up(x, y, above=0.5, weight=w, turns=True)

    assert torch.autograd.gradcheck(total, (x.requires_grad_(), y.requires_grad_()))


def test_what_is_not_a_number_shows_in_the_sum() -> None:
    assert added_up(torch.tensor([float("nan"), 0.5]), torch.zeros(2)).isnan()


def test_parts_of_larger_tensors_are_compared() -> None:
    images = torch.rand(4, 6, 3, generator=torch.Generator().manual_seed(1))
    left, right = images[:, :3], images[:, 3:]
    torch.testing.assert_close(added_up(left, right), (left - right).abs().sum())


@pytest.mark.parametrize("weighted", [False, True])
def test_images_without_pixels_add_up_to_nothing(weighted: bool) -> None:
    none = torch.zeros(0, 4, requires_grad=True)
    total = added_up(none, torch.zeros(0, 4), weight=torch.zeros(0, 4) if weighted else None)
    total.backward()
    assert total.item() == 0
    assert none.grad is not None
