"""How different images look: LPIPS (Zhang et al., "The unreasonable effectiveness of deep features", 2018).

A network trained to name objects sees both images. At five depths its features, scaled to unit length at each pixel,
are subtracted; the squares are weighted by heads that were fitted to people's judgements, averaged over the image and
added. This is version 0.1 of LPIPS. The paper's ``L_vgg`` takes VGG16 for the network.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.assets import asset_path
from dynhair.errors import DynhairError
from dynhair.losses.lpips_weights import LpipsWeights, read_lpips_weights

NetworkName = Literal["vgg16", "alexnet"]

_MEAN = (-0.030, -0.088, -0.188)
_DEVIATION = (0.458, 0.448, 0.450)
_LEAST_LENGTH = 1e-10


@dataclass(frozen=True)
class _Convolution:
    """A convolution followed by a rectifier."""

    inputs: int
    outputs: int
    size: int = 3
    stride: int = 1
    padding: int = 1


@dataclass(frozen=True)
class _Network:
    """The convolutions of a network in five stages, whose outputs are compared.

    Attributes:
        stages: convolutions in order.
        pooled: the stages that begin with a pooling by 2.
        window: pixels across the pooled windows.
        smallest: the least side of an image that reaches the last stage.
    """

    stages: tuple[tuple[_Convolution, ...], ...]
    pooled: frozenset[int]
    window: int
    smallest: int


_NETWORKS: dict[NetworkName, _Network] = {
    "vgg16": _Network(
        stages=(
            (_Convolution(3, 64), _Convolution(64, 64)),
            (_Convolution(64, 128), _Convolution(128, 128)),
            (_Convolution(128, 256), _Convolution(256, 256), _Convolution(256, 256)),
            (_Convolution(256, 512), _Convolution(512, 512), _Convolution(512, 512)),
            (_Convolution(512, 512), _Convolution(512, 512), _Convolution(512, 512)),
        ),
        pooled=frozenset({1, 2, 3, 4}),
        window=2,
        smallest=16,
    ),
    "alexnet": _Network(
        stages=(
            (_Convolution(3, 64, size=11, stride=4, padding=2),),
            (_Convolution(64, 192, size=5, padding=2),),
            (_Convolution(192, 384),),
            (_Convolution(384, 256),),
            (_Convolution(256, 256),),
        ),
        pooled=frozenset({1, 2}),
        window=3,
        smallest=31,
    ),
}


def lpips_loss(
    distance: PerceptualDistance, predicted: Float[Tensor, "*v h w 3"], target: Float[Tensor, "*v h w 3"]
) -> Float[Tensor, ""]:
    """The paper's ``L_vgg``: LPIPS averaged over the images.

    Args:
        distance: with VGG16, as :meth:`PerceptualDistance.pretrained` makes it.
        predicted: in [0, 1].
        target: in [0, 1].
    """
    return distance(predicted, target).mean()


class PerceptualDistance(nn.Module):
    """LPIPS. Its parameters are fixed; gradients flow to the images.

    Args:
        network: that compares; :meth:`pretrained` also gives it its weights.
    """

    def __init__(self, network: NetworkName) -> None:
        super().__init__()
        self._network = _NETWORKS[network]
        self.stages = nn.ModuleList(nn.Sequential(*self._layers(place)) for place in range(len(self._network.stages)))
        self.heads = nn.ParameterList(
            torch.full((stage[-1].outputs,), 1 / stage[-1].outputs) for stage in self._network.stages
        )
        self.register_buffer("_mean", torch.tensor(_MEAN))
        self.register_buffer("_deviation", torch.tensor(_DEVIATION))
        self.requires_grad_(False)
        # Images come with channels last. With kernels laid out like them a CPU takes half as long.
        nn.utils.convert_conv2d_weight_memory_format(self, torch.channels_last)

    _mean: Tensor
    _deviation: Tensor

    @classmethod
    def pretrained(cls, network: NetworkName = "vgg16") -> PerceptualDistance:
        """LPIPS with its published weights, which are downloaded when they are first needed.

        Raises:
            DynhairError: no source could give the weights.
        """
        distance = cls(network)
        distance.set_weights(read_lpips_weights(asset_path(f"lpips-{network}")))
        return distance

    def set_weights(self, weights: LpipsWeights) -> None:
        """Take weights over.

        Raises:
            DynhairError: they are another network's.
        """
        convolutions = [layer for layer in self.modules() if isinstance(layer, nn.Conv2d)]
        parameters = [parameter for layer in convolutions for parameter in layer.parameters()] + list(self.heads)
        given = [tensor for pair in weights.convolutions for tensor in pair] + weights.heads
        if [tensor.shape for tensor in parameters] != [tensor.shape for tensor in given]:
            raise DynhairError(
                f"these are not the weights of this network: {len(weights.convolutions)} convolutions",
                expected=f"{len(convolutions)} convolutions and {len(self.heads)} heads of the network's sizes",
            )
        with torch.no_grad():
            for parameter, tensor in zip(parameters, given, strict=True):
                parameter.copy_(tensor)

    def forward(self, first: Float[Tensor, "*v h w 3"], second: Float[Tensor, "*v h w 3"]) -> Float[Tensor, "*v"]:
        """The distance of each pair of images.

        Args:
            first: in [0, 1].
            second: in [0, 1].

        Returns:
            Not negative; 0 for equal images, and about 0.7 for unrelated ones.

        Raises:
            DynhairError: the images are too small for the network.
        """
        return self.between(self.features(first), self.features(second)).reshape(first.shape[:-3])

    def features(self, images: Float[Tensor, "*v h w 3"]) -> list[Float[Tensor, "b _ _ _"]]:
        """What the network sees: at each of five depths (images, channels, y, x), of unit length at each pixel.

        Features of images that do not change can be kept, and compared by :meth:`between`.

        Raises:
            DynhairError: the images are too small for the network.
        """
        height, width = images.shape[-3:-1]
        if min(height, width) < self._network.smallest:
            raise DynhairError(
                f"an image of {width} x {height} pixels is too small for LPIPS",
                expected=f"at least {self._network.smallest} each way",
            )
        centred = (2 * images - 1 - self._mean) / self._deviation
        seen = centred.reshape(-1, *images.shape[-3:]).permute(0, 3, 1, 2)
        features = []
        for stage in self.stages:
            seen = stage(seen)
            features.append(seen / (torch.linalg.vector_norm(seen, dim=1, keepdim=True) + _LEAST_LENGTH))
        return features

    def between(
        self, first: list[Float[Tensor, "b _ _ _"]], second: list[Float[Tensor, "b _ _ _"]]
    ) -> Float[Tensor, " b"]:
        """The distances of images whose features are given."""
        depths = [
            ((a - b).square().mean((2, 3)) * head).sum(1) for a, b, head in zip(first, second, self.heads, strict=True)
        ]
        return torch.stack(depths).sum(0)

    def _layers(self, place: int) -> Iterator[nn.Module]:
        if place in self._network.pooled:
            yield nn.MaxPool2d(self._network.window, stride=2)
        for layer in self._network.stages[place]:
            yield nn.Conv2d(layer.inputs, layer.outputs, layer.size, layer.stride, layer.padding)
            yield nn.ReLU(inplace=True)
