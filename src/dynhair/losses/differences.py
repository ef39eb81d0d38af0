"""Absolute differences of images added up in compiled code: PyTorch reads and writes images for each operation."""

from __future__ import annotations

import functools
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.native import Kernel, compiled, for_kernels, require_shapes
from dynhair.threads import run, shares


def added_up(
    predicted: Float[Tensor, "*shape"],
    target: Float[Tensor, "*shape"],
    *,
    above: float = 1.0,
    below: float = 1.0,
    weight: Float[Tensor, "*shape"] | None = None,
    turns: bool = False,
) -> Float[Tensor, ""]:
    """The sum of ``weight * |predicted - target|``; where compiled code does the work, differentiable once.

    Where the two are equal, the gradient is zero.

    Args:
        predicted: on the CPU in float32, if it alone asks for gradients, compiled code does the work.
        target: what it is compared with.
        above: factor on differences where the prediction is the greater one.
        below: factor on differences where it is the smaller one.
        weight: of each difference; one if not given.
        turns: these are angles in turns, of which whole ones do not count.

    Raises:
        DynhairError: the images differ in size.
    """
    given = [predicted, target] if weight is None else [predicted, target, weight]
    require_shapes(target=(target, predicted.shape), weight=(given[-1], predicted.shape))
    if for_kernels(*given) and not any(tensor.requires_grad for tensor in given[1:]):
        maps = [tensor.contiguous() for tensor in given]
        if weight is None:
            maps.append(predicted.new_empty(0))
        return _AddedUp.apply(*maps, predicted.new_tensor([above, below]), turns)  # pyright: ignore[reportReturnType]
    difference = predicted - target
    if turns:
        difference = difference - difference.detach().round()
    size = above * difference.relu() + below * (-difference).relu()
    return size.sum() if weight is None else (weight * size).sum()


class _AddedUp(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, predicted: Tensor, target: Tensor, weight: Tensor, slopes: Tensor, turns: bool) -> Tensor:
        ctx.save_for_backward(predicted, target, weight, slopes)
        ctx.turns = turns
        parts, nothing = shares(predicted.numel()), predicted.new_empty(0)
        sums = predicted.new_empty(len(parts))
        run(
            partial(
                _kernel(), *some, part, int(turns), int(weight.numel() > 0), 0,
                predicted, target, weight, slopes, nothing, sums, nothing,
            )
            for part, some in enumerate(parts)
        )  # fmt: skip
        return sums.sum()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        predicted, target, weight, slopes = ctx.saved_tensors
        gradient, scale = torch.empty_like(predicted), gradients[0].reshape(1)
        run(
            partial(
                _kernel(), *some, part, int(ctx.turns), int(weight.numel() > 0), 1,
                predicted, target, weight, slopes, scale, slopes[:0], gradient,
            )
            for part, some in enumerate(shares(predicted.numel()))
        )  # fmt: skip
        return gradient, None, None, None, None


@functools.cache
def _kernel() -> Kernel:
    return compiled(
        Path(__file__).with_name("native") / "differences.cpp",
        integers="first last part turns weighted back",
        arrays="predicted target weight slopes scale sum gradient",
    )
