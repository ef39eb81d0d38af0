"""The colours of a surface, as the views of the rest frame show them."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.training.static_views import RestViews

_HAIRLESS = 0.05
_FACING = 0.3
_DEPTH = 0.006  # metres; a point this little behind the visible surface is seen
_NEIGHBOURS = 8


def seen_colours(
    points: Float[Tensor, "k 3"],
    normals: Float[Tensor, "k 3"],
    views: RestViews,
    depth: Float[Tensor, "v h w"],
) -> Float[Tensor, "k 3"]:
    """The mean colour of each point over the views that see it without hair before it.

    Frontal views count more. What no view sees, under hair or from behind, takes the colours of the nearest points
    that are seen: skin under the hair begins as skin.

    Args:
        points: on the surface, head frame, metres.
        normals: of the surface there, unit length.
        views: images and hair masks.
        depth: of the surface in each view, metres; infinite where there is none.
    """
    height, width = depth.shape[1:]
    size = points.new_tensor([width, height])
    colours, weights = torch.zeros_like(points), points.new_zeros(len(points))
    for camera, rgb, hair, surface in zip(views.cameras, views.rgb, views.hair, depth, strict=True):
        pixels, z = camera.project(points)
        inside = ((pixels > 0) & (pixels < size)).all(1) & (z > 0)
        column, row = pixels.nan_to_num().long().clamp_min(0).minimum(size.long() - 1).unbind(1)
        facing = (normals * functional.normalize(camera.centre - points, dim=1)).sum(1)
        seen = inside & (z < surface[row, column] + _DEPTH) & (hair[row, column] < _HAIRLESS) & (facing > _FACING)
        weight = facing * seen
        at = (2 * pixels.nan_to_num() / size - 1)[None, None]
        sampled = functional.grid_sample(rgb.movedim(-1, 0)[None], at, align_corners=False, padding_mode="border")
        colours += weight[:, None] * sampled[0, :, 0].T
        weights += weight
    known = weights > 0
    if not known.any():
        return torch.full_like(points, 0.5)
    colours[known] /= weights[known, None]
    if not known.all():
        colours[~known] = _nearest_mean(points[~known], points[known], colours[known])
    return colours


def _nearest_mean(points: Tensor, known: Tensor, colours: Tensor) -> Tensor:
    from pykdtree.kdtree import KDTree

    _, nearest = KDTree(known.numpy()).query(points.numpy(), k=min(_NEIGHBOURS, len(known)))
    return colours[torch.from_numpy(nearest.astype("int64")).reshape(len(points), -1)].mean(1)
