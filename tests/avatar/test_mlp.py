"""The chunked perceptron against plain layers."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from dynhair.avatar.chunked import CHUNK
from dynhair.avatar.mlp import PointMLP


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


@pytest.mark.parametrize("threads", [1, 3])
def test_the_same_threads_give_the_same_bits(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynhair.threads._own", threads)
    monkeypatch.setattr("dynhair.avatar.chunked.LEAST_WORK", 0)
    torch.manual_seed(0)
    network = PointMLP(5, 2, (16, 16), 3)
    points, condition = torch.randn(5 * CHUNK, 5, requires_grad=True), torch.randn(2)

    def gradients() -> list[torch.Tensor]:
        return list(torch.autograd.grad(network(points, condition).square().sum(), [points, *network.parameters()]))

    once, again = gradients(), gradients()
    assert all(torch.equal(a, b) for a, b in zip(once, again, strict=True))
