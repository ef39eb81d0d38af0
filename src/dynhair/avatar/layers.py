"""What was drawn in one pass, taken apart: colours over the background, labels, the hair's direction."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.native import compiled, for_kernels, require_shapes
from dynhair.threads import run, shares


class Layers(NamedTuple):
    """Images of the same views.

    Attributes:
        seen: the channels that are seen, over the background; the first three are colours.
        hair: coverage by visible hair.
        body: coverage by visible head and upper body.
        direction: the hair's doubled angle, weighted by its coverage.
    """

    seen: Float[Tensor, "v h w c"]
    hair: Float[Tensor, "v h w"]
    body: Float[Tensor, "v h w"]
    direction: Float[Tensor, "v h w 2"]


def layers(
    features: Float[Tensor, "v h w f"], alpha: Float[Tensor, "v h w"], background: Float[Tensor, " c"]
) -> Layers:
    """Take an image of features apart, each layer in memory of its own.

    The losses run through each layer many times, and autograd would add up a whole image of zeros for each.

    Args:
        features: two labels, a doubled angle, and what is seen, over black.
        alpha: coverage by anything.
        background: behind what is seen; no gradient.

    Raises:
        DynhairError: the features are not those of this background and coverage.
    """
    require_shapes(features=(features, (*alpha.shape, 4 + len(background))))
    given = features, alpha, background
    return Layers(*(_CompiledLayers if for_kernels(*given) else _Layers).apply(*given))


class _Layers(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: Tensor, alpha: Tensor, background: Tensor) -> Any:
        ctx.save_for_backward(background)
        hair, body, *_ = features.unbind(-1)
        seen = torch.addcmul(features[..., 4:], (1 - alpha)[..., None], background)
        return seen, hair.contiguous(), body.contiguous(), features[..., 2:4].contiguous()

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        (background,) = ctx.saved_tensors
        seen, hair, body, direction = gradients
        return torch.cat([hair[..., None], body[..., None], direction, seen], -1), -(seen @ background), None


class _CompiledLayers(torch.autograd.Function):
    """The same on the CPU, where PyTorch's loops over so few values a pixel take several times as long."""

    @staticmethod
    def forward(ctx: Any, features: Tensor, alpha: Tensor, background: Tensor) -> Any:
        shape, channels = alpha.shape, len(background)
        found = [alpha.new_empty(size) for size in ((*shape, channels), shape, shape, (*shape, 2))]
        _split(features.contiguous(), alpha.contiguous(), background, found, back=False)
        ctx.save_for_backward(background)
        return tuple(found)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        (background,) = ctx.saved_tensors
        shape = gradients[1].shape
        features, alpha = (background.new_empty(size) for size in ((*shape, 4 + len(background)), shape))
        _split(features, alpha, background, [gradient.contiguous() for gradient in gradients], back=True)
        return features, alpha, None


def _split(features: Tensor, alpha: Tensor, background: Tensor, images: list[Tensor], *, back: bool) -> None:
    kernel = compiled(
        Path(__file__).with_name("native") / "layers.cpp",
        integers="first last channels back",
        arrays="features alpha background seen hair body direction",
    )
    channels, background = len(background), background.contiguous()
    run(
        partial(kernel, *some, channels, int(back), features, alpha, background, *images)
        for some in shares(alpha.numel())
    )
