"""The perceptual loss on parts of images: on a CPU whole images would take most of a training step."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.losses.perceptual import PerceptualDistance, lpips_loss

Crop = tuple[slice, slice]
"""Rows and columns of an image."""


def random_crops(person: Float[Tensor, "v h w"], size: int, *, generator: torch.Generator) -> list[Crop]:
    """Draw a square in each view about a random pixel that shows the person.

    Squares that would leave the image are moved back into it; where the image is the smaller of the two, it is taken
    whole. In a view that does not show the person the square lies about any pixel.

    Args:
        person: coverage by hair and body in [0, 1].
        size: side of the squares, pixels.
        generator: of random numbers, on the CPU.

    Raises:
        DynhairError: the squares have no pixels.
    """
    if size < 1:
        raise DynhairError(f"crops of {size} pixels are empty", expected="crops of at least 16 pixels each way")
    height, width = person.shape[1:]
    crops = []
    for shown in person:
        places = (shown.flatten() > 0.5).nonzero()[:, 0]
        drawn = int(torch.randint(len(places) or height * width, (1,), generator=generator))
        row, column = divmod(int(places[drawn]) if len(places) else drawn, width)
        crops.append((_about(row, size, height), _about(column, size, width)))
    return crops


def perceptual_crop_loss(
    distance: PerceptualDistance,
    predicted: Float[Tensor, "v h w 3"],
    target: Float[Tensor, "v h w 3"],
    crops: Sequence[Crop],
) -> Float[Tensor, ""]:
    """The paper's ``L_vgg`` ("Photometric losses") on one crop of each view.

    Args:
        distance: with VGG16, as :meth:`PerceptualDistance.pretrained` makes it.
        predicted: in [0, 1].
        target: in [0, 1].
        crops: one for each view, all of one size, as :func:`random_crops` draws them.

    Raises:
        DynhairError: the crops are too small for the network.
    """
    return lpips_loss(distance, _cut(predicted, crops), _cut(target.detach(), crops))


def _about(centre: int, size: int, extent: int) -> slice:
    start = max(min(centre - size // 2, extent - size), 0)
    return slice(start, min(start + size, extent))


def _cut(images: Float[Tensor, "v h w 3"], crops: Sequence[Crop]) -> Float[Tensor, "v y x 3"]:
    return torch.stack([image[crop] for image, crop in zip(images, crops, strict=True)])
