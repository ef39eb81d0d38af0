"""A small multi-layer perceptron for many points that share one condition."""

from __future__ import annotations

import statistics
import time

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.chunked import CHUNK, PointLayer, evaluate_chunked


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
        layers = []
        for index, layer in enumerate(self.layers):
            assert isinstance(layer, nn.Linear)
            if index not in (0, self.skip):
                layers.append(PointLayer(layer.weight, layer.bias))
                continue
            previous = layer.in_features - self.point_features - len(shared)
            *values, on_points, on_shared = layer.weight.split(
                [*([previous] if previous else []), self.point_features, len(shared)], dim=1
            )
            bias = layer.bias + on_shared @ shared
            layers.append(PointLayer(values[0], bias, on_points) if values else PointLayer(on_points, bias))
        return evaluate_chunked(points, layers, self.dtype)


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
