"""What the Inception network of the Frechet inception distance makes of images: 2048 features each.

Inception v3 (Szegedy et al., "Rethinking the Inception architecture for computer vision", 2016) as trained in 2015 for
TensorFlow, from which Heusel et al. (2017) take the output of the last pooling. Its three particularities against later
copies are kept: average pools leave out the padding, the last block pools by the maximum, and images are resized to 299
pixels from their first pixel on, not from the centres.
"""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.assets import asset_path
from dynhair.errors import DynhairError
from dynhair.evaluation.inception_weights import ConvolutionWeights, read_inception_weights

FEATURES = 2048
SIDE = 299
"""Pixels across the images that the network sees."""

ASSET = "inception-fid"


class InceptionNetwork(nn.Module):
    """The network; `pretrained` gives it its weights."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            _convolution(3, 32, 3, stride=2, padding=0),
            _convolution(32, 32, 3, padding=0),
            _convolution(32, 64, 3),
            nn.MaxPool2d(3, stride=2),
            _convolution(64, 80),
            _convolution(80, 192, 3, padding=0),
            nn.MaxPool2d(3, stride=2),
            _coarse(192, pooled=32),
            _coarse(256, pooled=64),
            _coarse(288, pooled=64),
            _halved_to_17(),
            *(_middle(width) for width in (128, 160, 160, 192)),
            _halved_to_8(),
            _fine(1280, _average()),
            _fine(2048, nn.MaxPool2d(3, stride=1, padding=1)),
            nn.AvgPool2d(8),
        )
        self.requires_grad_(False)
        # with kernels laid out like images whose channels come last
        nn.utils.convert_conv2d_weight_memory_format(self, torch.channels_last)

    @classmethod
    def pretrained(cls) -> InceptionNetwork:
        """The network with its published weights, which are downloaded when they are first needed.

        Raises:
            DynhairError: no source could give the weights.
        """
        return cls.from_file(asset_path(ASSET))

    @classmethod
    def from_file(cls, path: Path) -> InceptionNetwork:
        """The network with the weights of a file.

        Raises:
            DynhairError: the file holds no weights, or another network's.
        """
        network = cls()
        network.set_weights(read_inception_weights(path))
        return network.eval()

    def set_weights(self, weights: list[ConvolutionWeights]) -> None:
        """Take weights over.

        Args:
            weights: of the convolutions, from the image on; in a block, branch by branch.

        Raises:
            DynhairError: they are another network's.
        """
        convolutions = [layer for layer in self.modules() if isinstance(layer, nn.Conv2d)]
        if [layer.weight.shape for layer in convolutions] != [layer.kernel.shape for layer in weights]:
            raise DynhairError(
                f"these are not the weights of this network: {len(weights)} convolutions",
                expected=f"{len(convolutions)} convolutions of the sizes of Inception v3",
            )
        with torch.no_grad():
            for layer, given in zip(convolutions, weights, strict=True):
                kernel, bias = given.folded()
                layer.weight.copy_(kernel)
                assert layer.bias is not None
                layer.bias.copy_(bias)

    def forward(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v f"]:
        """`FEATURES` of each image.

        Args:
            images: sRGB in [0, 1], of any size. The network sees ``(255 x - 128) / 128``.
        """
        seen = (255.0 * resized(images) - 128.0) / 128.0
        return self.layers(seen.permute(0, 3, 1, 2)).flatten(1)


def resized(images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v s s 3"]:
    """Resize to `SIDE` pixels as TensorFlow 1 did.

    Pixel i is found at ``i * size / SIDE`` of the image, linearly between its neighbours; there is no filter against
    aliasing, also where the image is larger.
    """
    for axis in (1, 2):
        size = images.shape[axis]
        place = torch.arange(SIDE, dtype=torch.float64) * size / SIDE
        first = place.long()
        weight = (place - first).to(images.dtype).view(-1, *(1,) * (3 - axis))
        before, after = (images.index_select(axis, index) for index in (first, (first + 1).clamp_max(size - 1)))
        images = before.lerp(after, weight)
    return images


class _Branches(nn.Module):
    """Feeds branches with the same, and lays their channels one after the other."""

    def __init__(self, *branches: nn.Module) -> None:
        super().__init__()
        self.branches = nn.ModuleList(branches)

    def forward(self, seen: Float[Tensor, "v _ _ _"]) -> Float[Tensor, "v _ _ _"]:
        return torch.cat([branch(seen) for branch in self.branches], dim=1)


def _convolution(
    inputs: int, outputs: int, size: int | tuple[int, int] = 1, stride: int = 1, padding: int | None = None
) -> nn.Module:
    """A convolution and a rectifier. The image keeps its size unless a padding or stride is given."""
    height, width = (size, size) if isinstance(size, int) else size
    around = (height // 2, width // 2) if padding is None else padding
    return nn.Sequential(nn.Conv2d(inputs, outputs, (height, width), stride, around), nn.ReLU(inplace=True))


def _average() -> nn.Module:
    return nn.AvgPool2d(3, stride=1, padding=1, count_include_pad=False)


def _coarse(inputs: int, pooled: int) -> nn.Module:
    return _Branches(
        _convolution(inputs, 64),
        nn.Sequential(_convolution(inputs, 48), _convolution(48, 64, 5)),
        nn.Sequential(_convolution(inputs, 64), _convolution(64, 96, 3), _convolution(96, 96, 3)),
        nn.Sequential(_average(), _convolution(inputs, pooled)),
    )


def _halved_to_17() -> nn.Module:
    return _Branches(
        _convolution(288, 384, 3, stride=2, padding=0),
        nn.Sequential(_convolution(288, 64), _convolution(64, 96, 3), _convolution(96, 96, 3, stride=2, padding=0)),
        nn.MaxPool2d(3, stride=2),
    )


def _middle(width: int) -> nn.Module:
    row, column = (1, 7), (7, 1)
    return _Branches(
        _convolution(768, 192),
        nn.Sequential(_convolution(768, width), _convolution(width, width, row), _convolution(width, 192, column)),
        nn.Sequential(
            _convolution(768, width),
            _convolution(width, width, column),
            _convolution(width, width, row),
            _convolution(width, width, column),
            _convolution(width, 192, row),
        ),
        nn.Sequential(_average(), _convolution(768, 192)),
    )


def _halved_to_8() -> nn.Module:
    return _Branches(
        nn.Sequential(_convolution(768, 192), _convolution(192, 320, 3, stride=2, padding=0)),
        nn.Sequential(
            _convolution(768, 192),
            _convolution(192, 192, (1, 7)),
            _convolution(192, 192, (7, 1)),
            _convolution(192, 192, 3, stride=2, padding=0),
        ),
        nn.MaxPool2d(3, stride=2),
    )


def _fine(inputs: int, pool: nn.Module) -> nn.Module:
    def crossed() -> nn.Module:
        return _Branches(_convolution(384, 384, (1, 3)), _convolution(384, 384, (3, 1)))

    return _Branches(
        _convolution(inputs, 320),
        nn.Sequential(_convolution(inputs, 384), crossed()),
        nn.Sequential(_convolution(inputs, 448), _convolution(448, 384, 3), crossed()),
        nn.Sequential(pool, _convolution(inputs, 192)),
    )
