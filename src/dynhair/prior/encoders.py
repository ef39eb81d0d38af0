"""The networks that read hair's evidence: a coarse one for the hairstyle, a fine one for its strands."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from dynhair.avatar.encoding import encoded_size, positional_encoding
from dynhair.prior.evidence import CHANNELS, GRID
from dynhair.prior.sampling import sample_volume

Layer = TypeVar("Layer", bound=nn.Module)

LEADING = 10
"""Coefficients that the coarse network predicts, as Im2Haircut's does."""

SAMPLES = 12
"""Points of a strand at which the fine network reads the evidence."""

ROUNDS = 2
"""How often the fine network corrects the strands."""

_HEIGHTS = (1.0, 1.2, 1.4)
_FREQUENCIES = 4


@dataclass(frozen=True)
class EncoderSizes:
    """Widths of the networks.

    Attributes:
        volume: channels of the feature volume; its coarser levels have two and three times as many.
        code: numbers that describe the hairstyle as a whole.
        texture: channels of the scalp textures.
        point: channels of what is read at a point of a strand.
    """

    volume: int = 24
    code: int = 160
    texture: int = 48
    point: int = 24


class VolumeEncoder(nn.Module):
    """A pyramid of 3-D convolutions: features around every voxel, and a code for all."""

    def __init__(self, sizes: EncoderSizes) -> None:
        super().__init__()
        width = sizes.volume
        self.first = _strided(CHANNELS, width)
        self.first_block = _Residual(nn.Conv3d, width)
        self.second = _strided(width, 2 * width)
        self.second_block = _Residual(nn.Conv3d, 2 * width)
        self.third = _strided(2 * width, 3 * width)
        self.narrow = nn.Conv3d(3 * width, width, 1)
        cells = (GRID[0] // 8) * (GRID[1] // 8) * (GRID[2] // 8)
        self.code = nn.Linear(width * cells, sizes.code)
        self.spread = nn.Conv3d(2 * width, width, 1)

    def forward(self, volume: Float[Tensor, "b c d h w"]) -> tuple[Float[Tensor, "b f e i x"], Float[Tensor, "b k"]]:
        """Features at half the grid's resolution, and the code."""
        first = self.first_block(_activated(self.first(volume)))
        second = self.second_block(_activated(self.second(first)))
        third = _activated(self.narrow(_activated(self.third(second))))
        code = _activated(self.code(third.flatten(1)))
        context = nn.functional.interpolate(self.spread(second), first.shape[2:], mode="nearest")
        return _activated(first + context), code


class CoarseEncoder(nn.Module):
    """From the evidence to the leading coefficients of every texel of the scalp.

    Args:
        roots: of the texels, mean places on the scalp in scalp units; no scalp is a sphere.
        sizes: widths of the layers.
    """

    roots: Tensor
    places: Tensor

    def __init__(self, roots: Float[Tensor, "t 3"], sizes: EncoderSizes) -> None:
        super().__init__()
        self.register_buffer("roots", roots.clone())
        self.register_buffer("places", positional_encoding(roots, _FREQUENCIES), persistent=False)
        self.volume = VolumeEncoder(sizes)
        self.place = nn.Linear(encoded_size(3, _FREQUENCIES), sizes.texture)
        self.local = nn.Linear(sizes.volume * len(_HEIGHTS), sizes.texture)
        self.whole = nn.Linear(sizes.code, sizes.texture)
        self.blocks = nn.Sequential(_Residual(nn.Conv2d, sizes.texture), _Residual(nn.Conv2d, sizes.texture, 4))
        self.head = _zeroed(nn.Conv2d(sizes.texture, LEADING, 1))

    def forward(
        self, volume: Float[Tensor, "b c d h w"]
    ) -> tuple[Float[Tensor, "b k s s"], Float[Tensor, "b t s s"], Float[Tensor, "b f e i x"]]:
        """Predict.

        Returns:
            The leading coefficients in standard deviations about their mean; features of the texels; and the feature
            volume, at half the grid's resolution.
        """
        features, code = self.volume(volume)
        probes = (self.roots[:, None] * self.roots.new_tensor(_HEIGHTS)[:, None]).flatten(0, 1)
        local = sample_volume(features, probes.expand(len(volume), -1, -1)).unflatten(1, (-1, len(_HEIGHTS)))
        mixed = self.local(local.flatten(2)) + self.place(self.places) + self.whole(code)[:, None]
        texture = self.blocks(_as_texture(_activated(mixed)))
        return self.head(texture), texture, features


class FineEncoder(nn.Module):
    """From the evidence along the present strands to better ones: to corrections of all coefficients.

    What lies along a strand tells whether it lies where it should. The network is applied more than once.

    Args:
        count: coefficients of a strand.
        sizes: widths of the layers.
    """

    def __init__(self, count: int, sizes: EncoderSizes) -> None:
        super().__init__()
        self.around = nn.Conv3d(sizes.volume, sizes.point, 1)
        self.within = nn.Linear(CHANNELS, sizes.point, bias=False)
        self.course = nn.Linear(6, sizes.point, bias=False)
        self.strand = nn.Linear(sizes.point * SAMPLES, sizes.texture)
        self.before = nn.Conv2d(sizes.texture + count, sizes.texture, 1)
        self.blocks = nn.Sequential(_Residual(nn.Conv2d, sizes.texture), _Residual(nn.Conv2d, sizes.texture, 4))
        self.head = _zeroed(nn.Conv2d(sizes.texture, count, 1))

    def forward(
        self,
        volume: Float[Tensor, "b c d h w"],
        features: Float[Tensor, "b f e i x"],
        texture: Float[Tensor, "b t s s"],
        coefficients: Float[Tensor, "b n s s"],
        strands: Float[Tensor, "b m p 3"],
        texels: Int[Tensor, " m"],
    ) -> Float[Tensor, "b n s s"]:
        """Predict what is to be added to the coefficients, in standard deviations.

        Args:
            volume: the evidence.
            features: of the coarse network, on the same grid.
            texture: its features of the texels.
            coefficients: as they are, in standard deviations.
            strands: of these coefficients, in scalp units about the scalp's centre; taken as given.
            texels: flat indices of the texels that have these strands.
        """
        strands = strands.detach()
        tangents = torch.diff(strands, dim=2, append=2 * strands[..., -1:, :] - strands[..., -2:-1, :])
        shape = torch.cat([strands / 3, tangents / (tangents.norm(dim=-1, keepdim=True) + 1e-3)], -1).flatten(1, 2)
        points = strands.flatten(1, 2)
        read = sample_volume(self.around(features), points) + self.within(sample_volume(volume, points))
        along = _activated(read + self.course(shape)).unflatten(1, (-1, SAMPLES)).flatten(2)
        everywhere = along.new_zeros(len(along), texture[0, 0].numel(), texture.shape[1])
        mixed = _as_texture(everywhere.index_copy(1, texels, self.strand(along)))
        mixed = mixed + self.before(torch.cat([texture, coefficients], 1))
        return self.head(self.blocks(_activated(mixed)))


class _Residual(nn.Module):
    """Two convolutions whose result is added to their input; they begin as the identity."""

    def __init__(self, conv: Callable[..., nn.Module], width: int, dilation: int = 1) -> None:
        super().__init__()
        self.one = conv(width, width, 3, padding=dilation, dilation=dilation)
        self.two = _zeroed(conv(width, width, 3, padding=1))

    def forward(self, x: Tensor) -> Tensor:
        return _activated(x + self.two(_activated(self.one(x))))


def _as_texture(texels: Float[Tensor, "b t c"]) -> Float[Tensor, "b c s s"]:
    size = math.isqrt(texels.shape[1])
    return texels.mT.unflatten(-1, (size, size)).contiguous()


def _strided(before: int, after: int) -> nn.Conv3d:
    return nn.Conv3d(before, after, 3, stride=2, padding=1)


def _activated(x: Tensor) -> Tensor:
    # Plain ReLUs die in layers as narrow as these.
    return nn.functional.leaky_relu(x, 0.1)


def _zeroed(layer: Layer) -> Layer:
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)
    return layer
