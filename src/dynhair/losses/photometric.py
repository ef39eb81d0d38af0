"""Images against images (paper, "Photometric losses")."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.losses.differences import added_up
from dynhair.losses.native_ssim import mean_similarity
from dynhair.native import for_kernels

WINDOW = 11
"""Pixels across the Gaussian window of the structural similarity."""

SIGMA = 1.5
"""Its standard deviation, pixels."""


def l1_loss(predicted: Float[Tensor, "*shape"], target: Float[Tensor, "*shape"]) -> Float[Tensor, ""]:
    """Mean absolute difference, the paper's ``L_rgb``."""
    return added_up(predicted, target) / predicted.numel()


def ssim_loss(predicted: Float[Tensor, "*v h w c"], target: Float[Tensor, "*v h w c"]) -> Float[Tensor, ""]:
    """``1 - SSIM``, the paper's ``L_ssim``."""
    return 1 - ssim(predicted, target)


def ssim(first: Float[Tensor, "*v h w c"], second: Float[Tensor, "*v h w c"]) -> Float[Tensor, ""]:
    """Structural similarity of images, averaged over views, pixels and channels.

    Pixels whose window leaves the image are not counted. This is scikit-image's ``structural_similarity`` with
    ``gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1``.

    Args:
        first: in [0, 1]. On the CPU in float32, if it alone asks for gradients, compiled code does the work.
        second: in [0, 1].

    Returns:
        Similarity in [-1, 1].

    Raises:
        DynhairError: the images are smaller than the window.
    """
    height, width = first.shape[-3:-1]
    if min(height, width) < WINDOW:
        raise DynhairError(f"an image of {width} x {height} pixels has no SSIM", expected=f"at least {WINDOW} each way")
    if for_kernels(first, second) and not second.requires_grad:
        image, target = (images.reshape(-1, *images.shape[-3:]) for images in (first, second))
        return mean_similarity(image, target, _window(first))
    return _similarity(first, second).mean()


def ssim_map(first: Float[Tensor, "*v h w c"], second: Float[Tensor, "*v h w c"]) -> Float[Tensor, "*v h w c"]:
    """Structural similarity around each pixel (Wang et al. 2004; K1 = 0.01, K2 = 0.03).

    Images go on beyond their edges as if mirrored, edge pixels repeated: scikit-image's map for ``full=True``.

    Args:
        first: in [0, 1], at least five pixels each way.
        second: in [0, 1].

    Returns:
        Similarity in [-1, 1] for each pixel and channel.
    """
    return _similarity(_mirrored(first), _mirrored(second))


def _mirrored(images: Float[Tensor, "*v h w c"]) -> Float[Tensor, "*v y x c"]:
    """Add half a window of mirror image on each side."""
    margin = WINDOW // 2
    for axis in (-3, -2):
        size = images.shape[axis]
        before, after = images.narrow(axis, 0, margin), images.narrow(axis, size - margin, margin)
        images = torch.cat([before.flip(axis), images, after.flip(axis)], dim=axis)
    return images


def _similarity(first: Float[Tensor, "*v h w c"], second: Float[Tensor, "*v h w c"]) -> Float[Tensor, "*v y x c"]:
    """Structural similarity around the pixels whose windows lie in the image."""
    c1, c2 = 0.01**2, 0.03**2
    # Only the sum of the two variances is needed, so their second moments are blurred together.
    moments = torch.cat([first, second, first * first + second * second, first * second], dim=-1)
    mean_x, mean_y, square, product = _blur(moments).chunk(4, dim=-1)
    mean_product, mean_square = mean_x * mean_y, mean_x * mean_x + mean_y * mean_y
    luminance = (2 * mean_product + c1) / (mean_square + c1)
    return luminance * ((2 * (product - mean_product) + c2) / (square - mean_square + c2))


def _blur(images: Float[Tensor, "*v h w c"]) -> Float[Tensor, "*v y x c"]:
    """Gaussian blur, where the window lies in the image.

    Two depthwise convolutions, one along each axis, in the images' own layout with channels last: twice as fast as with
    channels first. Products with banded matrices are as fast as the latter at 256 pixels and slower beyond.
    """
    channels = images.shape[-1]
    weights = _window(images).expand(channels, 1, 1, -1)

    planes = images.reshape(-1, *images.shape[-3:]).permute(0, 3, 1, 2)
    planes = torch.nn.functional.conv2d(planes, weights.mT, groups=channels)
    planes = torch.nn.functional.conv2d(planes, weights, groups=channels)
    blurred = planes.permute(0, 2, 3, 1)
    return blurred.reshape(*images.shape[:-3], *blurred.shape[1:])


def _window(images: Tensor) -> Float[Tensor, " k"]:
    """The window's weights along one axis, like the images."""
    offsets = torch.arange(WINDOW, dtype=images.dtype, device=images.device) - WINDOW // 2
    weights = torch.exp(-0.5 * (offsets / SIGMA) ** 2)
    return weights / weights.sum()
