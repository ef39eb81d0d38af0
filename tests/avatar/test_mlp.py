"""The chunked perceptron against plain layers."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from dynhair.avatar.mlp import CHUNK, PointMLP


@pytest.mark.parametrize("depth", [1, 2, 3, 5])
@pytest.mark.parametrize("shared", [0, 4])
@pytest.mark.parametrize("count", [0, 1, CHUNK + 3])
def test_chunks_and_shared_inputs_change_nothing(depth: int, shared: int, count: int) -> None:
    generator = torch.Generator().manual_seed(0)
    torch.manual_seed(0)
    network = PointMLP(3, shared, (8,) * depth, 2).double()
    points = torch.randn(count, 3, generator=generator).double()
    condition = torch.randn(shared, generator=generator).double()
    inputs = torch.cat([points, condition.expand(count, shared)], 1)
    x = inputs
    for index, layer in enumerate(network.layers):
        if depth == 5 and index == 2:
            x = torch.cat([x, inputs], 1)
        x = layer(x)
        if index < depth:
            x = functional.leaky_relu(x)
    actual = network(points, condition)
    torch.testing.assert_close(actual, x)
    weight = torch.randn(x.shape, generator=generator).double()
    for a, b in zip(
        torch.autograd.grad((actual * weight).sum(), list(network.parameters())),
        torch.autograd.grad((x * weight).sum(), list(network.parameters())),
        strict=True,
    ):
        torch.testing.assert_close(a, b)
