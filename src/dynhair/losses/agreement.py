"""Colours that are compared only where labels agree."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.native import compiled, for_kernels, require_shapes
from dynhair.threads import run, shares


def agreed(
    colours: Float[Tensor, "v h w c"],
    truth: Float[Tensor, "v h w c"],
    labels: tuple[Float[Tensor, "v h w"], Float[Tensor, "v h w"]],
    true_labels: tuple[Float[Tensor, "v h w"], Float[Tensor, "v h w"]],
) -> Float[Tensor, "v h w c"]:
    """The colours where the labels are right, and the truth's where they are not.

    Labels are shares of hair, body and background, and what they have in common says how far a pixel's colours count.

    Args:
        colours: drawn; they alone get a gradient.
        truth: what they are to be compared with.
        labels: drawn shares of hair and of body.
        true_labels: the truth's.

    Raises:
        DynhairError: the images differ in size.
    """
    size = colours.shape[:-1]
    require_shapes(
        truth=(truth, colours.shape),
        hair=(labels[0], size),
        body=(labels[1], size),
        true_hair=(true_labels[0], size),
        true_body=(true_labels[1], size),
    )
    given = colours, truth, *labels, *true_labels
    if for_kernels(*given):
        return _Agreed.apply(*given)  # pyright: ignore[reportReturnType]
    hair, body = (found.detach() - true for found, true in zip(labels, true_labels, strict=True))
    off = hair.abs() + body.abs() + (hair + body).abs()
    return torch.lerp(colours, truth, (off / 2).clamp(0, 1)[..., None])


class _Agreed(torch.autograd.Function):
    """PyTorch's loops over so few channels take many times as long."""

    @staticmethod
    def forward(ctx: Any, colours: Tensor, truth: Tensor, *labels: Tensor) -> Tensor:
        kept = tuple(label.contiguous() for label in labels)
        ctx.save_for_backward(*kept)
        result = torch.empty_like(truth, memory_format=torch.contiguous_format)
        _agree(colours.contiguous(), truth.contiguous(), kept, result, back=False)
        return result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        given = gradients[0].contiguous()
        colours = torch.empty_like(given)
        _agree(colours, given, ctx.saved_tensors, given, back=True)
        return colours, None, None, None, None, None


def _agree(colours: Tensor, truth: Tensor, labels: tuple[Tensor, ...], result: Tensor, *, back: bool) -> None:
    kernel = compiled(
        Path(__file__).with_name("native") / "agree.cpp",
        integers="first last channels back",
        arrays="colours truth hair body true_hair true_body result",
    )
    channels = colours.shape[-1]
    run(
        partial(kernel, *some, channels, int(back), colours, truth, *labels, result)
        for some in shares(labels[0].numel())
    )
