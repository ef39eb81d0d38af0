"""Leaky-ReLU layers for drawing alone, on the CPU: nothing is differentiated, and points are the same in every frame.

What a layer makes of the points themselves is then the same as well: it is multiplied out once. The rest is a compiled
pass in which a point's activations never leave the processor's cache. PyTorch's operations, a chunk of points at a time
(:mod:`dynhair.avatar.chunked`), take several times as long for layers as small as these.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import pad

from dynhair.avatar.branches import Branches, Rows, rows_of
from dynhair.avatar.mlp import PointMLP
from dynhair.errors import DynhairError
from dynhair.native import Kernel, compiled, require_shapes
from dynhair.threads import run, shares

_SOURCE = Path(__file__).with_name("native") / "frozen_layers.cpp"
LANES = 16
THIN = 4  # as in the kernel


class FrozenLayers:
    """Layers whose weights do not change.

    Args:
        weights: first to last; the first may see nothing.
        given: what layers add for the points themselves, one row a point; for two layers at most.

    Raises:
        DynhairError: a shape does not fit the others, or more than two layers are given something.
    """

    def __init__(
        self, weights: Sequence[Float[Tensor, "_ _"]], given: Mapping[int, Float[Tensor, "n _"]] | None = None
    ) -> None:
        given = given or {}
        if len(given) > 2:
            raise DynhairError(f"points bring their own terms to {len(given)} layers", expected="two at most")
        self._sizes = [(weight.shape[1], len(weight)) for weight in weights]
        for weight, (_, before) in zip(weights[1:], self._sizes[:-1], strict=True):
            require_shapes(weights=(weight, (len(weight), before)))
        *before, last = weights
        laid = [*(_laid_out(weight, last=False) for weight in before), _laid_out(last, last=True)]
        self._weights = torch.cat([weight.flatten() for weight in laid])
        self._given = [pad(rows, (0, _lacking(rows.shape[1]))).contiguous() for rows in given.values()]
        for layer, rows in given.items():
            require_shapes(given=(rows, (len(self._given[0]), self._sizes[layer][1])))
        kinds = [1 + list(given).index(layer) if layer in given else 0 for layer in range(len(weights))]
        table = [(*size, kind) for size, kind in zip(self._sizes, kinds, strict=True)]
        self._table = torch.tensor(table, dtype=torch.int32)
        widest = max(max(size) for size in self._sizes)
        self._widest = widest + _lacking(widest)

    @torch.no_grad()
    def __call__(
        self, biases: Sequence[Float[Tensor, " _"]], points: Float[Tensor, "n p"] | None = None
    ) -> Float[Tensor, "n o"]:
        """Apply the layers to every point, a leaky ReLU after each but the last.

        Args:
            biases: of all layers.
            points: what the first layer sees; None if that is nothing.
        """
        if points is None:
            points = torch.empty(len(self._given[0]), 0)
        require_shapes(points=(points, (len(self._given[0]) if self._given else len(points), self._sizes[0][0])))
        for bias, (_, width) in zip(biases, self._sizes, strict=True):
            require_shapes(biases=(bias, (width,)))
        laid = torch.cat([pad(bias, (0, _lacking(len(bias)))) for bias in biases])
        given, again = (*self._given, laid, laid)[:2]  # what is not there is not read
        outputs = torch.empty(len(points), self._sizes[-1][1])
        arguments = self._table, points.contiguous(), self._weights, laid, given, again, outputs
        kernel, layers = _kernel(self._widest), len(self._sizes)
        run(partial(kernel, *some, layers, *arguments) for some in shares(len(points)))
        return outputs


class FrozenMLP:
    """A :class:`PointMLP` over points that do not change; asked the same again, it answers from memory.

    Args:
        network: whose weights do not change either.
        points: its points' features.
        share: factor on each point's outputs.
        bounded: whether the outputs pass through tanh before.
    """

    def __init__(
        self, network: PointMLP, points: Float[Tensor, "n p"], share: Float[Tensor, " n"], *, bounded: bool
    ) -> None:
        weights: list[Tensor] = []
        given: dict[int, Tensor] = {}
        self._biases: list[tuple[Tensor, Tensor | None]] = []  # with what weighs the shared features
        for index, layer in enumerate(network.layers):
            assert isinstance(layer, torch.nn.Linear)
            weight, on_shared = layer.weight.detach(), None
            if index in (0, network.skip):
                before = network.layers[index - 1].out_features if index else 0
                assert isinstance(before, int)
                shared = weight.shape[1] - before - network.point_features
                weight, on_points, on_shared = weight.split([before, network.point_features, shared], 1)
                given[index] = points @ on_points.T
            weights.append(weight)
            self._biases.append((layer.bias.detach(), on_shared))
        self._layers = FrozenLayers(weights, given)
        self._share, self._bounded = share[:, None], bounded
        self._known: tuple[Tensor, Tensor] | None = None

    def __call__(self, shared: Float[Tensor, " s"]) -> Float[Tensor, "n o"]:
        """What the network says of the points, not to be changed in place."""
        if self._known is None or not torch.equal(self._known[0], shared):
            values = self._layers(
                [bias if weight is None else torch.addmv(bias, weight, shared) for bias, weight in self._biases]
            )
            self._known = shared.clone(), (values.tanh_() if self._bounded else values).mul_(self._share)
        return self._known[1]


class FrozenBranches:
    """A pair of networks over points that do not change.

    Args:
        branches: the pair.
        points: the points' features.
        weight: of the expression, in [0, 1].
    """

    @torch.no_grad()
    def __init__(self, branches: Branches, points: Float[Tensor, "k p"], weight: Float[Tensor, " k"]) -> None:
        parts = (branches.on_expression, weight), (branches.on_pose, 1 - weight)
        self._count = len(points)
        self._rows: list[Rows] = [rows_of(share) for _, share in parts]
        self._networks = [
            FrozenMLP(network, points[rows], share[rows], bounded=branches.bounded)
            for (network, share), rows in zip(parts, self._rows, strict=True)
        ]

    def __call__(self, expression: Float[Tensor, " e"], pose_code: Float[Tensor, " q"]) -> Float[Tensor, "k o"]:
        """As :meth:`Branches.forward`."""
        by_expression, by_pose = self._networks[0](expression), self._networks[1](pose_code)
        on_expression, on_pose = self._rows
        blended = by_pose.new_zeros(self._count, by_pose.shape[1])
        blended[on_expression] = by_expression
        if isinstance(on_pose, slice):
            blended[on_pose] += by_pose
        else:
            blended.index_add_(0, on_pose, by_pose)
        return blended


def _laid_out(weight: Tensor, *, last: bool) -> Tensor:
    """A layer's weights as the kernel reads them."""
    if last and len(weight) <= THIN:
        return pad(weight, (0, _lacking(weight.shape[1])))
    return pad(weight.T, (0, _lacking(len(weight)))).contiguous()


def _lacking(width: int) -> int:
    """How much a width lacks to whole vectors."""
    return -width % LANES


def _kernel(widest: int) -> Kernel:
    arrays = "sizes:i32 points weights biases given again outputs"
    return compiled(_SOURCE, integers="first last layers", arrays=arrays, channels=widest)
