"""Hair as the cameras see it: the strands' Gaussians with their labels, image directions and colours."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from dynhair.avatar.spherical_harmonics import harmonics_colours
from dynhair.camera import Camera
from dynhair.native import Kernel, compiled, for_kernels, require_shapes
from dynhair.strands import projected_orientation, root_taper, strand_gaussians
from dynhair.threads import run, shares

LABELS = (1.0, 0.0)  # hair, and not body
COLOURS = slice(4, 7)
"""Where the features hold the colour: after two labels and a doubled angle."""

_SOURCES = Path(__file__).with_name("native")
_INTEGERS = "first last count points views"


class DrawnHair(NamedTuple):
    """The Gaussians of ``N`` strands of ``L`` points, ``n = N * (L - 1)``, strand by strand, root first.

    Attributes:
        means: world, metres.
        quats: wxyz.
        scales: standard deviations, metres.
        features: for each view the labels "hair" and "body", the doubled angle of the direction in the image, and the
            colour.
    """

    means: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"]
    scales: Float[Tensor, "n 3"]
    features: Float[Tensor, "v n 7"]


def drawn_hair(
    strands: Float[Tensor, "m l 3"],
    widths: Float[Tensor, " m"],
    base: Float[Tensor, "1 3 n"],
    higher: Float[Tensor, "15 3 n"],
    cameras: Sequence[Camera],
) -> DrawnHair:
    """The strands' Gaussians and what each camera sees of them.

    On the CPU in float32, compiled code does in one pass over the strands what :func:`plain_drawn_hair` does in many.

    Args:
        strands: world, metres.
        widths: of the strands, metres; they narrow towards the root, and get no gradient.
        base: harmonics of degree 0.
        higher: of degrees 1 to 3.
        cameras: the views; they get no gradient.

    Raises:
        DynhairError: the widths or harmonics are not those of these strands.
    """
    count = strands.shape[0] * (strands.shape[1] - 1)
    require_shapes(widths=(widths, strands.shape[:1]), base=(base, (1, 3, count)), higher=(higher, (15, 3, count)))
    given = strands, base, higher, widths
    if not for_kernels(*given):
        return plain_drawn_hair(strands, widths, base, higher, cameras)
    views = torch.stack([_packed(camera) for camera in cameras])
    taper = root_taper(strands.shape[1] - 1).float()
    return DrawnHair(*_DrawnHair.apply(*(tensor.contiguous() for tensor in given), taper, views))


def plain_drawn_hair(
    strands: Float[Tensor, "m l 3"],
    widths: Float[Tensor, " m"],
    base: Float[Tensor, "1 3 n"],
    higher: Float[Tensor, "15 3 n"],
    cameras: Sequence[Camera],
) -> DrawnHair:
    """The same in PyTorch, on any device."""
    hair = strand_gaussians(strands, widths, root_taper(strands.shape[1] - 1))
    eyes = torch.stack([camera.centre for camera in cameras])
    # a colour must not move what it is the colour of
    sights = nn.functional.normalize(hair.means.detach() - eyes[:, None], dim=-1)
    colours = harmonics_colours(base, higher, sights)
    directions = torch.stack([projected_orientation(hair.means, hair.directions, camera) for camera in cameras])
    labels = colours.new_tensor(LABELS).expand(*colours.shape[:2], 2)
    return DrawnHair(hair.means, hair.quats, hair.scales, torch.cat([labels, directions, colours], -1))


class _DrawnHair(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, strands: Tensor, base: Tensor, higher: Tensor, widths: Tensor, taper: Tensor, views: Tensor
    ) -> Any:
        (count, points, _), seen = strands.shape, len(views)
        n = count * (points - 1)
        means, quats, scales, features = (strands.new_empty(shape) for shape in ((n, 3), (n, 4), (n, 3), (seen, n, 7)))
        kernel, written = _forward(), (means, quats, scales, features)
        run(
            partial(kernel, *some, count, points, seen, strands, widths, taper, views, base, higher, *written)
            for some in shares(count)
        )
        ctx.save_for_backward(strands, views, features)
        return means, quats, scales, features

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        strands, views, features = ctx.saved_tensors
        (count, points, _), n = strands.shape, features.shape[1]
        of_strands = torch.zeros_like(strands)
        of_base, of_higher = strands.new_empty(1, 3, n), strands.new_empty(15, 3, n)
        given, kernel = [gradient.contiguous() for gradient in gradients], _backward()
        run(
            partial(
                kernel,
                *some,
                count,
                points,
                len(views),
                strands,
                views,
                features,
                *given,
                of_strands,
                of_base,
                of_higher,
            )
            for some in shares(count)
        )
        return of_strands, of_base, of_higher, None, None, None


def _packed(camera: Camera) -> Float[Tensor, "16"]:
    """A view as the kernels read it: rotation, translation, centre, ratio of the focal lengths."""
    rotation, translation = camera.w2c[:, :3], camera.w2c[:, 3]
    ratio = (camera.K[1, 1] / camera.K[0, 0])[None]
    return torch.cat([rotation.reshape(-1), translation, camera.centre, ratio]).float()


def _forward() -> Kernel:
    arrays = "strands widths taper cameras base higher means quats scales features"
    return compiled(_SOURCES / "strands.cpp", _SOURCES / "draw_strands.cpp", integers=_INTEGERS, arrays=arrays)


def _backward() -> Kernel:
    arrays = "strands cameras features of_means of_quats of_scales of_features of_strands of_base of_higher"
    return compiled(_SOURCES / "strands.cpp", _SOURCES / "draw_strands_backward.cpp", integers=_INTEGERS, arrays=arrays)
