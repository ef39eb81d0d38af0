"""Leaky-ReLU layers over many points, a chunk at a time, with a backward pass of their own.

Layer by layer over all points, hidden activations go through memory again and again; chunk by chunk they stay in the
processor's cache. Autograd would keep twice the activations, and add up a whole gradient for each chunk.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

CHUNK = 4096
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
        kept = []
        for rows in _chunks(points):
            chunk = points[rows]
            values = [chunk]
            for index, layer in enumerate(layers):
                x = torch.addmm(layer.bias, values[-1].to(layer.weight.dtype), layer.weight.T)
                if layer.skip is not None:
                    x.addmm_(chunk.to(x.dtype), layer.skip.T)
                if index + 1 < len(layers):
                    values.append(torch.nn.functional.leaky_relu_(x, SLOPE))
                else:
                    outputs[rows] = x
            if differentiated:
                kept.extend(values[1:])
        ctx.dtype, ctx.hidden = dtype, len(layers) - 1
        ctx.none = [tensor is None for tensor in flat]
        ctx.save_for_backward(points, *kept, *[tensor for tensor in flat if tensor is not None])
        return outputs

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        gradient_out = gradients[0].contiguous()
        saved = list(ctx.saved_tensors)
        points = saved.pop(0)
        chunks = _chunks(points)
        kept, given = saved[: ctx.hidden * len(chunks)], iter(saved[ctx.hidden * len(chunks) :])
        flat = [None if none else next(given) for none in ctx.none]
        layers = _layers(flat, points.dtype, ctx.dtype)
        totals = [_each(layer, lambda tensor: torch.zeros_like(tensor, dtype=points.dtype)) for layer in layers]
        point_gradient = torch.zeros_like(points) if ctx.needs_input_grad[0] else None
        for number, rows in enumerate(chunks):
            chunk = points[rows]
            values = [chunk, *kept[number * ctx.hidden : (number + 1) * ctx.hidden]]
            gradient = gradient_out[rows]
            for index in reversed(range(len(layers))):
                layer, total, x = layers[index], totals[index], values[index]
                gradient = gradient.to(layer.weight.dtype)
                total.weight.add_(gradient.T @ x.to(gradient.dtype))
                total.bias.add_(gradient.sum(0))
                if layer.skip is not None and total.skip is not None:
                    total.skip.add_(gradient.T @ chunk.to(gradient.dtype))
                    if point_gradient is not None:
                        point_gradient[rows] += gradient @ layer.skip
                if index > 0:
                    gradient = gradient @ layer.weight
                    # the sign of an activation is that of the value before the leaky ReLU
                    gradient = torch.ops.aten.leaky_relu_backward(gradient, x.to(gradient.dtype), SLOPE, True)
                elif point_gradient is not None:
                    point_gradient[rows] += gradient @ layer.weight
        return (point_gradient, None, *[tensor for total in totals for tensor in total])


def _layers(flat: Sequence[Any], full: torch.dtype, dtype: torch.dtype) -> list[PointLayer]:
    layers = [PointLayer(*flat[start : start + 3]) for start in range(0, len(flat), 3)]
    kinds = [dtype] * (len(layers) - 1) + [full]
    return [_each(layer, functools.partial(Tensor.to, dtype=kind)) for layer, kind in zip(layers, kinds, strict=True)]


def _each(layer: PointLayer, change: Callable[[Tensor], Tensor]) -> PointLayer:
    return PointLayer(change(layer.weight), change(layer.bias), None if layer.skip is None else change(layer.skip))


def _chunks(points: Tensor) -> list[slice]:
    size = len(points) if points.is_cuda else CHUNK
    return [slice(start, start + size) for start in range(0, len(points), max(size, 1))]
