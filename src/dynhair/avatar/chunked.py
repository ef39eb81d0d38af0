"""Leaky-ReLU layers over many points, a chunk at a time, with a backward pass of their own.

Layer by layer over all points, hidden activations go through memory again and again; chunk by chunk they stay in the
processor's cache. Autograd would keep twice the activations, and add up a whole gradient for each chunk.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.threads import run, thread_count

CHUNK = 2048
LEAST_WORK = 1 << 26  # multiply-adds of a chunk in its largest layer: about a millisecond
THIN = 8  # outputs up to which BLAS is up to three times as fast with the points along the longer side of the result
SLOPE = 0.01  # of the leaky ReLU for negative values, PyTorch's default


class PointLayer(NamedTuple):
    """One layer: ``weight @ x + bias``, and ``skip @ points`` where the layer sees the points again.

    Attributes:
        weight: for the previous layer's values, or for the points in the first layer.
        bias: shared by all points.
        skip: for the points; None in most layers.
    """

    weight: Float[Tensor, "out in"]
    bias: Float[Tensor, " out"]
    skip: Float[Tensor, "out p"] | None = None


def evaluate_chunked(
    points: Float[Tensor, "n p"], layers: list[PointLayer], dtype: torch.dtype | None = None
) -> Float[Tensor, "n o"]:
    """Apply the layers to every point, a leaky ReLU after each but the last; differentiable once.

    Args:
        points: inputs.
        layers: first to last.
        dtype: precision of all layers but the last; None for that of the points. The last layer is thin: in full
            precision it costs little, and it does not round the result.
    """
    flat = [tensor for layer in layers for tensor in layer]
    return _ChunkedLayers.apply(points, dtype or points.dtype, *flat)  # pyright: ignore[reportReturnType]


class _ChunkedLayers(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, points: Tensor, dtype: torch.dtype, *flat: Tensor | None) -> Tensor:
        layers = _layers(flat, points.dtype, dtype)
        differentiated = any(ctx.needs_input_grad)
        outputs = points.new_empty(len(points), len(layers[-1].bias))
        chunks = _chunks(points)
        kept: list[list[Tensor]] = [[] for _ in chunks]

        def evaluate(number: int) -> None:
            chunk = points[chunks[number]]
            values = [chunk]
            for index, layer in enumerate(layers):
                x = _affine(layer, values[-1].to(layer.weight.dtype))
                if layer.skip is not None:
                    x.addmm_(chunk.to(x.dtype), layer.skip.T)
                if index + 1 < len(layers):
                    values.append(torch.nn.functional.leaky_relu_(x, SLOPE))
                else:
                    outputs[chunks[number]] = x
            if differentiated:
                kept[number] = values[1:]

        run(partial(_without_autograd, evaluate, share) for share in _shares(len(chunks), layers))
        ctx.dtype, ctx.hidden = dtype, len(layers) - 1
        ctx.none = [tensor is None for tensor in flat]
        ctx.save_for_backward(points, *chain(*kept), *[tensor for tensor in flat if tensor is not None])
        return outputs

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        gradient_out = gradients[0].contiguous()
        saved = list(ctx.saved_tensors)
        points = saved.pop(0)
        chunks = _chunks(points)
        kept, given = saved[: ctx.hidden * len(chunks)], iter(saved[ctx.hidden * len(chunks) :])
        layers = _layers([None if none else next(given) for none in ctx.none], points.dtype, ctx.dtype)
        shares = _shares(len(chunks), layers)
        sums = [[_each(layer, partial(torch.zeros_like, dtype=points.dtype)) for layer in layers] for _ in shares]
        point_gradient = torch.empty_like(points) if ctx.needs_input_grad[0] else None

        def differentiate(totals: list[PointLayer], number: int) -> None:
            rows = chunks[number]
            values = [points[rows], *kept[number * ctx.hidden : (number + 1) * ctx.hidden]]
            gradient = gradient_out[rows]
            by_skips = []
            for index in reversed(range(len(layers))):
                layer, total, x = layers[index], totals[index], values[index]
                gradient = gradient.to(layer.weight.dtype)
                _add_product(total.weight, gradient.T, x)
                total.bias.add_(gradient.sum(0))
                if layer.skip is not None and total.skip is not None:
                    _add_product(total.skip, gradient.T, values[0])
                    by_skips.append((gradient, layer.skip))
                if index > 0:
                    gradient = gradient @ layer.weight
                    # the sign of an activation is that of the value before the leaky ReLU
                    torch.ops.aten.leaky_relu_backward.grad_input(
                        gradient, x.to(gradient.dtype), SLOPE, True, grad_input=gradient
                    )
                elif point_gradient is not None:
                    if gradient.dtype == point_gradient.dtype:
                        torch.mm(gradient, layer.weight, out=point_gradient[rows])
                    else:
                        point_gradient[rows] = gradient @ layer.weight
                    for product in by_skips:
                        _add_product(point_gradient[rows], *product)

        run(
            partial(_without_autograd, partial(differentiate, totals), share)
            for totals, share in zip(sums, shares, strict=True)
        )
        for totals in sums[1:]:  # in a fixed order, so that the same threads give the same bits
            for total, other in zip(chain(*sums[0]), chain(*totals), strict=True):
                if total is not None and other is not None:
                    total.add_(other)
        return (point_gradient, None, *chain(*sums[0]))


def _affine(layer: PointLayer, x: Tensor) -> Tensor:
    """``weight @ x + bias`` of each row."""
    if len(layer.bias) > THIN:
        return torch.addmm(layer.bias, x, layer.weight.T)
    return torch.addmm(layer.bias[:, None], layer.weight, x.T).T


def _add_product(total: Tensor, first: Tensor, second: Tensor) -> None:
    """Add a product in the first factor's precision."""
    if total.dtype == first.dtype:
        total.addmm_(first, second.to(first.dtype))
    else:
        total.add_(first @ second.to(first.dtype))


def _without_autograd(work: Callable[[int], None], numbers: range) -> None:
    with torch.no_grad():  # a thread of its own has a gradient mode of its own
        for number in numbers:
            work(number)


def _shares(chunks: int, layers: Sequence[PointLayer]) -> list[range]:
    """Contiguous chunks for each thread, if threads are worth their while.

    Threads wait for Python's lock between operations: where those are short, the waiting takes longer than the work.
    """
    work = CHUNK * max(layer.weight.numel() for layer in layers)
    count = max(min(thread_count(), chunks), 1) if work >= LEAST_WORK else 1
    return [range(chunks * part // count, chunks * (part + 1) // count) for part in range(count)]


def _layers(flat: Sequence[Any], full: torch.dtype, dtype: torch.dtype) -> list[PointLayer]:
    layers = [PointLayer(*flat[start : start + 3]) for start in range(0, len(flat), 3)]
    kinds = [dtype] * (len(layers) - 1) + [full]
    return [_each(layer, partial(Tensor.to, dtype=kind)) for layer, kind in zip(layers, kinds, strict=True)]


def _each(layer: PointLayer, change: Callable[[Tensor], Tensor]) -> PointLayer:
    return PointLayer(change(layer.weight), change(layer.bias), None if layer.skip is None else change(layer.skip))


def _chunks(points: Tensor) -> list[slice]:
    size = len(points) if points.is_cuda else CHUNK
    return [slice(start, start + size) for start in range(0, len(points), max(size, 1))]
