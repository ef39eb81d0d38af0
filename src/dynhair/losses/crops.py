"""The perceptual loss on parts of images: on a CPU whole images would take most of a training step."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.errors import DynhairError
from dynhair.losses.perceptual import PerceptualDistance, lpips_loss
from dynhair.threads import run, thread_count

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
    seen, known = _cut(predicted, crops), _cut(target.detach(), crops)
    if seen.device.type == "cpu" and min(thread_count(), len(seen)) > 1:
        distances: Tensor = _DistancesOnThreads.apply(seen, known, distance)  # pyright: ignore[reportAssignmentType]
        return distances.mean()
    return lpips_loss(distance, seen, known)


class _DistancesOnThreads(torch.autograd.Function):
    """A thread for each view, which takes the network forth and at once back."""

    @staticmethod
    def forward(ctx: Any, seen: Tensor, known: Tensor, distance: PerceptualDistance) -> Tensor:
        distances, gradients = seen.new_empty(len(seen)), torch.zeros_like(seen)
        differentiate = ctx.needs_input_grad[0]

        def compare(view: int) -> None:
            with torch.enable_grad():  # off inside a function, and every thread's own
                image = seen[view].detach().requires_grad_(differentiate)
                found = distance(image, known[view])
                distances[view] = found.detach()
                if differentiate:
                    (gradients[view],) = torch.autograd.grad(found, image)

        run(partial(compare, view) for view in range(len(seen)))
        ctx.save_for_backward(gradients)
        return distances

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *outer: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        (gradients,) = ctx.saved_tensors
        return gradients * outer[0][:, None, None, None], None, None


def _about(centre: int, size: int, extent: int) -> slice:
    start = max(min(centre - size // 2, extent - size), 0)
    return slice(start, min(start + size, extent))


def _cut(images: Float[Tensor, "v h w 3"], crops: Sequence[Crop]) -> Float[Tensor, "v y x 3"]:
    return torch.stack([image[crop] for image, crop in zip(images, crops, strict=True)])
