"""Images against images (paper, "Photometric losses")."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError

WINDOW = 11
"""Pixels across the Gaussian window of the structural similarity."""

SIGMA = 1.5
"""Its standard deviation, pixels."""


def l1_loss(predicted: Float[Tensor, "*shape"], target: Float[Tensor, "*shape"]) -> Float[Tensor, ""]:
    """Mean absolute difference, the paper's ``L_rgb``."""
    return (predicted - target).abs().mean()


def ssim_loss(predicted: Float[Tensor, "*v h w c"], target: Float[Tensor, "*v h w c"]) -> Float[Tensor, ""]:
    """``1 - SSIM``, the paper's ``L_ssim``."""
    return 1 - ssim(predicted, target)


def ssim(first: Float[Tensor, "*v h w c"], second: Float[Tensor, "*v h w c"]) -> Float[Tensor, ""]:
    """Structural similarity of images, averaged over views, pixels and channels.

    Pixels whose window leaves the image are not counted. This is scikit-image's ``structural_similarity`` with
    ``gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1``.

    Args:
        first: in [0, 1].
        second: in [0, 1].

    Returns:
        Similarity in [-1, 1].

    Raises:
        DynhairError: the images are smaller than the window.
    """
    height, width = first.shape[-3:-1]
    if min(height, width) < WINDOW:
        raise DynhairError(f"an image of {width} x {height} pixels has no SSIM", expected=f"at least {WINDOW} each way")
    margin = WINDOW // 2
    return ssim_map(first, second)[..., margin:-margin, margin:-margin, :].mean()


def ssim_map(first: Float[Tensor, "*v h w c"], second: Float[Tensor, "*v h w c"]) -> Float[Tensor, "*v h w c"]:
    """Structural similarity around each pixel (Wang et al. 2004; K1 = 0.01, K2 = 0.03).

    Images go on beyond their edges as if mirrored, edge pixels repeated: scikit-image's map for ``full=True``.

    Args:
        first: in [0, 1], at least five pixels each way.
        second: in [0, 1].

    Returns:
        Similarity in [-1, 1] for each pixel and channel.
    """
    c1, c2 = 0.01**2, 0.03**2
    # Only the sum of the two variances is needed, so their second moments are blurred together.
    moments = torch.stack([first, second, first * first + second * second, first * second])
    mean_x, mean_y, square, product = _blur(moments)
    mean_product, mean_square = mean_x * mean_y, mean_x * mean_x + mean_y * mean_y
    luminance = (2 * mean_product + c1) / (mean_square + c1)
    return luminance * (2 * (product - mean_product) + c2) / (square - mean_square + c2)


def _blur(images: Float[Tensor, "*v h w c"]) -> Float[Tensor, "*v h w c"]:
    """Gaussian blur over height and width.

    Two depthwise convolutions, one along each axis. Multiplying with banded matrices is as fast at 256 pixels and half
    as fast again at 512.
    """
    margin = WINDOW // 2
    offsets = torch.arange(-margin, margin + 1, dtype=images.dtype, device=images.device)
    weights = torch.exp(-0.5 * (offsets / SIGMA) ** 2)
    weights = weights / weights.sum()

    planes = images.movedim(-1, -3)
    stacked = planes.flatten(0, -3)[None]
    channels = stacked.shape[1]
    along_height = weights.view(1, 1, -1, 1).expand(channels, -1, -1, -1)
    along_width = weights.view(1, 1, 1, -1).expand(channels, -1, -1, -1)
    padded = torch.cat([stacked[..., :margin, :].flip(-2), stacked, stacked[..., -margin:, :].flip(-2)], dim=-2)
    blurred = torch.nn.functional.conv2d(padded, along_height, groups=channels)
    padded = torch.cat([blurred[..., :margin].flip(-1), blurred, blurred[..., -margin:].flip(-1)], dim=-1)
    blurred = torch.nn.functional.conv2d(padded, along_width, groups=channels)
    return blurred.view(planes.shape).movedim(-3, -1)
