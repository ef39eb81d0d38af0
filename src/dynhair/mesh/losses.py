"""What a surface that is fitted to images should be like: smooth, and as large as the images say."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor


def laplacian_loss(vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"]) -> Float[Tensor, ""]:
    """Mean squared length of the uniform Laplacian: from each vertex to the mean of those that share an edge with it.

    A weight for lengths in another unit becomes one for metres when it is divided by the square of that unit in metres:
    Gaussian Head Avatar's weight of 100, in canonical units of 0.1 m, is 100 / 0.1^2 = 10,000.

    Args:
        vertices: metres.
        faces: triangles.

    Returns:
        Square metres; vertices without faces count as smooth, and a mesh without vertices has zero.
    """
    count = len(vertices)
    if not count:
        return vertices.sum()
    starts, ends = faces.long().T.flatten(), faces.long().roll(-1, 1).T.flatten()
    edges = torch.unique(torch.minimum(starts, ends) * count + torch.maximum(starts, ends))
    first, second = edges // count, edges % count
    difference = vertices.index_select(0, second) - vertices.index_select(0, first)
    sums = torch.zeros_like(vertices).index_add(0, first, difference).index_add(0, second, -difference)
    neighbours = torch.bincount(torch.cat([first, second]), minlength=count).clamp_min(1)
    return (sums / neighbours[:, None]).square().sum(1).mean()


def silhouette_iou_loss(
    predicted: Float[Tensor, "*v h w"], target: Float[Tensor, "*v h w"], counted: Float[Tensor, "*v h w"] | None = None
) -> Float[Tensor, ""]:
    """One less the intersection over union of soft masks, ``1 - sum(p t) / sum(p + t - p t)``, mean over the images.

    Args:
        predicted: rendered coverage in [0, 1].
        target: masks in [0, 1].
        counted: weight of each pixel, in [0, 1]; one if not given.

    Returns:
        In [0, 1]; zero only where both masks are hard and equal. A union of less than a pixel is divided by one pixel.
    """
    weight = torch.ones_like(target) if counted is None else counted
    overlap = predicted * target
    union = predicted + target - overlap
    differing = (weight * (union - overlap)).sum((-2, -1))
    return (differing / (weight * union).sum((-2, -1)).clamp_min(1.0)).mean()
