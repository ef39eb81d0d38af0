"""A small multi-layer perceptron for many points that share one condition."""

from __future__ import annotations

import statistics
import time

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

# Points evaluated together: hidden activations of this many points stay in the processor's cache.
CHUNK = 4096


class PointNetwork(nn.Module):
    """A network whose hidden layers can be evaluated in another precision than its inputs.

    Attributes:
        dtype: that precision; None for that of the inputs.
    """

    dtype: torch.dtype | None = None


class PointMLP(PointNetwork):
    """Leaky-ReLU layers; with five or more hidden layers, a skip repeats the input at the middle one.

    The input is a number of varying features for each point, and a condition shared by all points. The shared part
    enters as a bias of the layers that see the input, so that it costs nothing per point.

    Args:
        point_features: features of a point.
        shared_features: features shared by the points of one call; may be 0.
        hidden: sizes of the hidden layers.
        outputs: the output's size.
    """

    def __init__(self, point_features: int, shared_features: int, hidden: tuple[int, ...], outputs: int) -> None:
        super().__init__()
        self.point_features = point_features
        self.skip = len(hidden) // 2 if len(hidden) >= 5 else None
        features = point_features + shared_features
        sizes = (*hidden, outputs)
        self.layers = nn.ModuleList()
        for index, size in enumerate(sizes):
            extra = features if index == self.skip else 0
            previous = features if index == 0 else sizes[index - 1]
            self.layers.append(nn.Linear(previous + extra, size))

    def forward(self, points: Float[Tensor, "n p"], shared: Float[Tensor, " s"]) -> Float[Tensor, "n o"]:
        """Evaluate all points under one condition, in chunks."""
        weights: list[tuple[list[Tensor], Tensor]] = []
        for index, layer in enumerate(self.layers):
            assert isinstance(layer, nn.Linear)
            weight, bias = layer.weight, layer.bias
            parts = []
            if index not in (0, self.skip):
                parts.append(weight)
            else:
                split = weight.shape[1] - self.point_features - shared.shape[0]
                if split:
                    parts.append(weight[:, :split])
                parts.append(weight[:, split : split + self.point_features])
                bias = bias + weight[:, split + self.point_features :] @ shared
            weights.append((parts, bias))
        return evaluate_chunked(points, weights, self.dtype or points.dtype)


def evaluate_chunked(
    points: Float[Tensor, "n p"], layers: list[tuple[list[Tensor], Tensor]], dtype: torch.dtype
) -> Float[Tensor, "n o"]:
    """Apply leaky-ReLU layers to the points, a chunk at a time.

    Args:
        points: inputs.
        layers: the weights of each layer, each ``(out, in)``, and its bias, ``(out,)`` or one row a point ``(n, out)``.
            The first layer has one weight, for the points; a later layer has one for the previous layer and, at a skip,
            a second one for the points.
        dtype: precision of all layers but the last.

    Returns:
        The last layer's values, in the points' precision.
    """
    # the last layer is thin: in full precision it costs little and does not round the result
    kinds = [dtype] * (len(layers) - 1) + [points.dtype]
    cast = [
        ([weight.to(kind) for weight in parts], bias.to(kind))
        for (parts, bias), kind in zip(layers, kinds, strict=True)
    ]
    points = points.to(dtype)
    if points.is_cuda or len(points) <= CHUNK:
        return _evaluate(points, cast)
    # split, not slices: the gradients of slices would each be as large as the whole
    per_point = [bias.split(CHUNK) if bias.dim() == 2 else None for _, bias in cast]
    outputs = []
    for index, chunk in enumerate(points.split(CHUNK)):
        layers = [
            (parts, bias if rows is None else rows[index]) for (parts, bias), rows in zip(cast, per_point, strict=True)
        ]
        outputs.append(_evaluate(chunk, layers))
    return torch.cat(outputs)


def _evaluate(points: Tensor, layers: list[tuple[list[Tensor], Tensor]]) -> Tensor:
    x = points
    for index, (parts, bias) in enumerate(layers):
        weight = parts[0]
        if bias.dim() == 1:
            y = functional.linear(x.to(weight.dtype), weight, bias)
        else:
            y = functional.linear(x.to(weight.dtype), weight) + bias
        if len(parts) == 2:
            y = y + functional.linear(points.to(weight.dtype), parts[1])
        x = functional.leaky_relu(y) if index + 1 < len(layers) else y
    return x


def use_precision(module: nn.Module, dtype: torch.dtype | None) -> None:
    """Evaluate the hidden layers of all point networks inside ``module`` in ``dtype``; parameters keep theirs."""
    for part in module.modules():
        if isinstance(part, PointNetwork):
            part.dtype = dtype


def quick_precision(device: torch.device) -> torch.dtype:
    """bfloat16 where a hidden layer measures clearly faster in it than in float32: some machines only emulate it."""
    seconds = {}
    for dtype in (torch.float32, torch.bfloat16):
        points, weight = (
            torch.ones(CHUNK, 128, device=device, dtype=dtype),
            torch.ones(128, 128, device=device, dtype=dtype),
        )
        times = []
        for _ in range(10):
            began = time.perf_counter()
            (points @ weight).sum().item()
            times.append(time.perf_counter() - began)
        seconds[dtype] = statistics.median(times)
    return torch.bfloat16 if seconds[torch.bfloat16] < 0.8 * seconds[torch.float32] else torch.float32
