"""Undirected 2D orientations of strands in the image.

An orientation is an angle in [0, 1) of pi, from +x towards +y, image y down. Angles that wrap cannot be averaged or
blended; their doubled angles ``(cos 2a, sin 2a)`` can.
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.camera import Camera

END_ON = 1e-3
"""Radians to the line of sight below which a direction has hardly an orientation in the image."""

NEGLIGIBLE_MAGNITUDE = 1e-3
"""Of a blended doubled angle, below which it does not pull on the strands."""


def projected_orientation(
    means: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"], camera: Camera
) -> Float[Tensor, "n 2"]:
    """Doubled angles of directions in space as the camera sees them.

    A direction is carried into the image by the exact differential of the perspective projection at its mean. The
    result is a unit vector that fades to zero, with bounded gradients and no change of angle, for a direction that
    points at the camera.

    Args:
        means: where the directions are, world, metres.
        directions: unit directions, world; their signs do not matter.
        camera: the view.

    Returns:
        ``(cos 2a, sin 2a)``.
    """
    rotation = camera.w2c[:, :3]
    x, y, z = (means @ rotation.T + camera.w2c[:, 3]).unbind(-1)
    dx, dy, dz = (directions @ rotation.T).unbind(-1)
    # The differential times z^2 / fx: the scale is of no importance, and nothing is divided by the depth.
    across = dx * z - x * dz
    down = (dy * z - y * dz) * (camera.K[1, 1] / camera.K[0, 0])
    across2, down2 = across * across, down * down
    scale = 1 / (across2 + down2 + END_ON**2 * (x * x + y * y + z * z))
    return torch.stack([(across2 - down2) * scale, 2 * across * down * scale], dim=-1)


def encode_orientation(orientation: Float[Tensor, "*n"]) -> Float[Tensor, "*n 2"]:
    """Angles of pi to doubled angles ``(cos 2a, sin 2a)``."""
    return torch.stack([torch.cos(2 * torch.pi * orientation), torch.sin(2 * torch.pi * orientation)], dim=-1)


def decode_orientation(doubled: Float[Tensor, "*n 2"]) -> Float[Tensor, "*n"]:
    """Doubled angles of any magnitude, such as blended ones, to angles in [0, 1) of pi.

    The angle's gradient grows as the magnitude falls, without bound. Where the magnitude is negligible, for want of
    hair or because strands that cross cancel out, the gradient is zero.
    """
    return _Decoded.apply(doubled)  # pyright: ignore[reportReturnType]


class _Decoded(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, doubled: Tensor) -> Tensor:
        ctx.save_for_backward(doubled)
        cosine, sine = (part.contiguous() for part in doubled.unbind(-1))  # for vectors of them
        turns = torch.atan2(sine, cosine).div_(2 * torch.pi)
        wrapped = torch.where(turns < 0, turns + 1, turns)
        # Just below zero, a turn added rounds to one.
        return torch.where(wrapped < 1, wrapped, 0.0)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        (doubled,) = ctx.saved_tensors
        cosine, sine = (part.contiguous() for part in doubled.unbind(-1))
        squared = (sine * sine).addcmul_(cosine, cosine)
        # nothing is divided by what is negligible
        squared.masked_fill_(squared < NEGLIGIBLE_MAGNITUDE**2, torch.inf)
        scale = (gradients[0] / (2 * torch.pi)).div_(squared)
        return torch.stack([-sine * scale, cosine * scale], -1)
