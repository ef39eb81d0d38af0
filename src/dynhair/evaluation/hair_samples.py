"""The same number of hair points for all that are compared, and the same ones in every frame."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.strands import resample_strands

STRANDS = 100
"""Strands of every hair that is measured: those that a simulated capture keeps of its truth."""

POINTS = 32
"""Points of each, at equal steps of arc length."""

_SEED = 0


class StrandSample:
    """Takes some strands of a hairstyle, always the same, at `POINTS` points.

    Args:
        available: strands of the hairstyle.
        count: of the sample; all that there are, if these are fewer. A hair of fewer strands than another is compared
            with as many of that.
    """

    def __init__(self, available: int, count: int = STRANDS) -> None:
        self._chosen = _choose(available, count)

    def __call__(self, strands: Float[Tensor, "n l 3"]) -> Float[Tensor, "_ _ 3"]:
        """The sample of one frame's strands, on the CPU in float64, in their frame and unit."""
        chosen = strands.detach().cpu()[self._chosen].double()
        return resample_strands(chosen, POINTS)


class PointSample:
    """Takes some points of hair without strands, always the same.

    Args:
        hair: indices of its points, such as `hair_gaussians` gives.
        count: of the sample; all that there are, if these are fewer.
    """

    def __init__(self, hair: Int[Tensor, " h"], count: int = STRANDS * POINTS) -> None:
        self._chosen = hair.cpu()[_choose(len(hair), count)]

    def __call__(self, points: Float[Tensor, "g 3"]) -> Float[Tensor, "_ 3"]:
        """The sample of one frame's points, on the CPU in float64, in their frame and unit."""
        return points.detach().cpu()[self._chosen].double()


def hair_gaussians(
    means: Float[Tensor, "g 3"], hair: Bool[Tensor, "v h w"], cameras: Sequence[Camera]
) -> Int[Tensor, " _"]:
    """Select the Gaussians of a head without strands that are hair (paper, "Quantitative evaluation").

    The paper takes those whose projections fall within the hair's silhouette in the first frame, and does not say from
    which cameras. Here it is more than half of those that have the projection in their image: from behind, the face
    too falls into the silhouette, and from before, the hair on the back of the head falls onto the face.

    Args:
        means: world, metres, in the first frame.
        hair: the truth's hair silhouettes in that frame.
        cameras: that see them.

    Returns:
        Indices of the Gaussians, rising; empty where no camera sees hair.

    Raises:
        DynhairError: there are not as many silhouettes as cameras.
    """
    if len(cameras) != len(hair):
        raise DynhairError(f"{len(hair)} silhouettes were seen by {len(cameras)} cameras", expected="one of each")
    means = means.detach().cpu().float()
    seen, inside = torch.zeros(len(means), dtype=torch.int64), torch.zeros(len(means), dtype=torch.int64)
    for silhouette, camera in zip(hair.cpu(), cameras, strict=True):
        height, width = silhouette.shape
        pixels, depths = camera.to("cpu", torch.float32).project(means)
        # Pixel (i, j) covers [i, i + 1) x [j, j + 1).
        in_view = (depths > 0) & (pixels >= 0).all(dim=1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
        columns, rows = pixels[in_view].long().unbind(dim=1)
        seen += in_view
        inside[in_view] += silhouette[rows, columns]
    return torch.nonzero(2 * inside > seen).flatten()


def _choose(available: int, count: int) -> Int[Tensor, " _"]:
    generator = torch.Generator().manual_seed(_SEED)
    return torch.randperm(available, generator=generator)[:count].sort().values
