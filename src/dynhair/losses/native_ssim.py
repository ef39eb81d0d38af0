"""The mean structural similarity on the CPU, in one pass over the images and one back."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.native import Kernel, compiled, require_shapes
from dynhair.threads import run, shares

_SOURCES = Path(__file__).with_name("native")
_INTEGERS = "first last height width channels"
SPARE = 32  # floats beyond a row, so that vectors may be stored whole
_DERIVATIVES = "of_mean of_square of_product"


def mean_similarity(
    image: Float[Tensor, "n h w c"], target: Float[Tensor, "n h w c"], window: Float[Tensor, " k"]
) -> Float[Tensor, ""]:
    """Mean over the pixels whose windows lie in the image; differentiable in the image alone.

    Args:
        image: on the CPU, float32.
        target: likewise.
        window: weights along one axis, of 11 pixels.

    Raises:
        DynhairError: the images differ in size.
    """
    require_shapes(target=(target, image.shape), window=(window, (11,)))
    return _MeanSimilarity.apply(image.contiguous(), target.contiguous(), window)  # pyright: ignore[reportReturnType]


class _MeanSimilarity(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, window: Tensor) -> Tensor:
        count, height, width, channels = image.shape
        rows, kept = height - len(window) + 1, (width - len(window) + 1) * channels
        sums = image.new_empty(count * rows)
        differentiate = ctx.needs_input_grad[0]
        derivatives = [image.new_empty(count * rows * kept if differentiate else 0) for _ in range(3)]
        kernel, room = _forward(), 4 * (width * channels + SPARE)
        run(
            partial(
                kernel, *some, height, width, channels, int(differentiate),
                image, target, window, image.new_zeros(room), sums, *derivatives,
            )
            for some in shares(count * rows)
        )  # fmt: skip
        ctx.save_for_backward(image, target, window, *derivatives)
        ctx.size = sums.numel() * kept
        return (sums.double().sum() / ctx.size).float()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        image, target, window, *derivatives = ctx.saved_tensors
        count, height, width, channels = image.shape
        gradient = torch.empty_like(image)
        kernel, room = _backward(), 3 * ((width + len(window) - 1) * channels + SPARE)
        run(
            partial(
                kernel, *some, height, width, channels,
                image, target, window, *derivatives, image.new_zeros(room), gradient,
            )
            for some in shares(count * height)
        )  # fmt: skip
        return gradient.mul_(gradients[0] / ctx.size), None, None


def _forward() -> Kernel:
    arrays = f"image target weights columns sums {_DERIVATIVES}"
    return compiled(_SOURCES / "ssim.cpp", integers=f"{_INTEGERS} differentiate", arrays=arrays)


def _backward() -> Kernel:
    arrays = f"image target weights {_DERIVATIVES} columns gradient"
    return compiled(_SOURCES / "ssim_backward.cpp", integers=_INTEGERS, arrays=arrays)
