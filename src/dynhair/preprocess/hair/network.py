"""The capture's own hair network: a U-Net small enough to be trained on a CPU within two minutes."""

from __future__ import annotations

import itertools

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from dynhair.preprocess.hair.bisenet import ConvBlock

WIDTHS = (8, 16, 24, 32)
"""Channels at full resolution and at every halving."""
STRIDE = 2 ** (len(WIDTHS) - 1)


class HairNetwork(nn.Module):
    """A U-Net (Ronneberger et al. 2015) whose output sees some 70 pixels around it.

    That is enough for the texture of hair, and too little to learn where on a head hair grows: views from behind have
    no face beside the hair, and must look the same to the network.
    """

    def __init__(self) -> None:
        super().__init__()
        inputs = (3, *WIDTHS[:-1])
        self.down = nn.ModuleList(
            nn.Sequential(ConvBlock(i, o, 3), ConvBlock(o, o, 3)) for i, o in zip(inputs, WIDTHS, strict=True)
        )
        self.up = nn.ModuleList(ConvBlock(fine + coarse, fine, 3) for fine, coarse in itertools.pairwise(WIDTHS))
        self.out = nn.Conv2d(WIDTHS[0], 1, 1)

    def forward(self, images: Float[Tensor, "n 3 h w"]) -> Float[Tensor, "n h w"]:
        """Logits of the hair's coverage.

        Args:
            images: colours in [-1, 1], zero outside the body; h and w multiples of :data:`STRIDE`.
        """
        x, levels = images, []
        for index, stage in enumerate(self.down):
            x = stage(functional.max_pool2d(x, 2) if index else x)
            levels.append(x)
        for stage, level in zip(reversed(self.up), reversed(levels[:-1]), strict=True):
            x = functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
            x = stage(torch.cat((level, x), dim=1))
        return self.out(x)[:, 0]
