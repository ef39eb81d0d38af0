"""Image metrics of the paper's Experiments section, as pure functions on a batch of views.

Each returns one value a view; ``nan`` marks a view where the metric is not defined (a region without pixels).
"""

from __future__ import annotations

from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.losses import ssim_map
from dynhair.losses.photometric import WINDOW

PSNR_CEILING = 100.0
"""Decibels; what identical images score, so that a mean over frames stays finite."""

SILHOUETTE_THRESHOLD = 0.5
"""Coverage above which a pixel belongs to the hair."""


def silhouette(coverage: Float[Tensor, "v h w"]) -> Bool[Tensor, "v h w"]:
    """Select the pixels that hair covers by more than `SILHOUETTE_THRESHOLD`."""
    return coverage > SILHOUETTE_THRESHOLD


def psnr(
    images: Float[Tensor, "v h w 3"], truth: Float[Tensor, "v h w 3"], region: Bool[Tensor, "v h w"] | None = None
) -> Float[Tensor, " v"]:
    """Peak signal-to-noise ratio, ``-10 log10(MSE)`` decibels for values in [0, 1], at most `PSNR_CEILING`.

    Args:
        images: in [0, 1].
        truth: in [0, 1].
        region: the pixels over which the squared error of the three channels is averaged; all when left out.

    Returns:
        Decibels; ``nan`` for a view whose region is empty.
    """
    return decibels(squared_error(images, truth), region)


def squared_error(images: Float[Tensor, "v h w 3"], truth: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v h w"]:
    """Mean over the channels of the squared difference of each pixel."""
    red, green, blue = (images - truth).square().unbind(dim=-1)  # three times as fast as a mean over three
    return (red + green + blue) / 3.0


def decibels(error: Float[Tensor, "v h w"], region: Bool[Tensor, "v h w"] | None = None) -> Float[Tensor, " v"]:
    """`psnr` of images whose `squared_error` is known."""
    return -10.0 * _mean_over(error, region).clamp_min(10.0 ** (-PSNR_CEILING / 10.0)).log10()


def ssim(
    images: Float[Tensor, "v h w 3"], truth: Float[Tensor, "v h w 3"], region: Bool[Tensor, "v h w"] | None = None
) -> Float[Tensor, " v"]:
    """Structural similarity (Wang et al. 2004): Gaussian window of 11 pixels, sigma 1.5, K1 = 0.01, K2 = 0.03.

    Args:
        images: in [0, 1].
        truth: in [0, 1].
        region: see `mean_similarity`.

    Returns:
        Similarity in [-1, 1]; ``nan`` for a view whose region is empty.
    """
    return mean_similarity(ssim_map(images, truth), region)


def mean_similarity(
    similarity: Float[Tensor, "v h w 3"], region: Bool[Tensor, "v h w"] | None = None
) -> Float[Tensor, " v"]:
    """Average a map of structural similarity over the pixels whose window lies inside the image.

    Args:
        similarity: of whole images, so that windows at a region's border see the pixels beyond it.
        region: the pixels that are averaged; all when left out.
    """
    margin = WINDOW // 2
    inner = (slice(None), slice(margin, -margin), slice(margin, -margin))
    return _mean_over(similarity.mean(dim=-1)[inner], None if region is None else region[inner])


def label_error(
    coverage: Float[Tensor, "v h w"], truth: Float[Tensor, "v h w"], region: Bool[Tensor, "v h w"]
) -> Float[Tensor, " v"]:
    """Mean ``|coverage - truth|`` of a label over a region.

    Returns:
        In [0, 1]; ``nan`` for a view whose region is empty.
    """
    return _mean_over((coverage - truth).abs(), region)


def silhouette_iou(first: Bool[Tensor, "v h w"], second: Bool[Tensor, "v h w"]) -> Float[Tensor, " v"]:
    """Intersection over union of two silhouettes, ``|A & B| / |A | B|``.

    With an avatar's and the truth's silhouette of one frame this is the hair IoU; with the silhouettes of frames t
    and t + 1 from one camera it is the temporal tIoU, of the avatar or of the truth.

    Returns:
        Overlap in [0, 1]; ``nan`` for a view where both silhouettes are empty.
    """
    intersection = (first & second).sum(dim=(1, 2)).double()
    union = (first | second).sum(dim=(1, 2)).double()
    return intersection / union


def _mean_over(values: Float[Tensor, "v h w"], region: Bool[Tensor, "v h w"] | None) -> Float[Tensor, " v"]:
    if region is None:
        return values.mean(dim=(1, 2))
    return (values * region).sum(dim=(1, 2)) / region.sum(dim=(1, 2))
