"""Where hair is at rest, for methods that know no strands: the visual hull of the training views' hair masks."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from dynhair.errors import DynhairError
from dynhair.training.rest_scene import RestScene

VOXEL = 0.01
"""Metres: edge of the cells that the hull is first looked for in."""

REACH = 0.6
"""Metres: hair is looked for so far from the scalp, downwards, ..."""

BREADTH = 0.15
"""... and so far to all sides, metres."""

COVERED = 0.9
"""Share of the views of a point that must show hair there."""

VIEWS = 2
"""Views that must see a point, if there are so many."""

BEHIND = 0.01
"""Metres: what lies so far behind the visible skin is not seen."""

DRAWS = 20
"""Rounds of drawing points, at most."""


@dataclass(frozen=True)
class HairPoints:
    """Points of the hair's volume in the rest frame.

    Attributes:
        positions: head frame, metres.
        colours: as the views show them, in [0, 1].
    """

    positions: Float[Tensor, "n 3"]
    colours: Float[Tensor, "n 3"]


def hair_points(scene: RestScene, count: int, seed: int) -> HairPoints:
    """Draw points evenly from the volume that all training views of the rest frame show as hair.

    Without views from behind nothing tells where hair ends at the back, so points lie near the head and are seen by
    two views or more.

    Args:
        scene: the rest frame.
        count: number of points.
        seed: of the draw.

    Raises:
        DynhairError: no place is hair in all views that see it.
    """
    scalp = scene.vertices[scene.faces[scene.scalp].flatten()]
    low, high = scalp.amin(0) - BREADTH, scalp.amax(0) + BREADTH
    low[1] = scalp[:, 1].amax() - REACH
    axes = [torch.arange(float(a) + VOXEL / 2, float(b), VOXEL) for a, b in zip(low, high, strict=True)]
    # a cell is looked into if its centre is hair or nearly
    grid = _shows_hair(torch.cartesian_prod(*axes), scene, 0.5)[0].view([len(axis) for axis in axes])
    near = functional.max_pool3d(grid[None, None].float(), 3, 1, 1)[0, 0] > 0
    cells = torch.stack([axis[index] for axis, index in zip(axes, torch.nonzero(near).T, strict=True)], 1)
    random = torch.Generator().manual_seed(seed)
    found, colours, missing = list[Tensor](), list[Tensor](), count
    for _ in range(DRAWS):
        if not len(cells) or missing <= 0:
            break
        drawn = cells[torch.randint(len(cells), (2 * count,), generator=random)]
        drawn = drawn + VOXEL * (torch.rand(drawn.shape, generator=random) - 0.5)
        hair, colour = _shows_hair(drawn, scene, COVERED)
        found.append(drawn[hair][:missing])
        colours.append(colour[hair][:missing])
        missing -= len(found[-1])
    if missing > 0:
        raise DynhairError(
            f"the views of the rest frame agree on {count - missing} of {count} places of hair",
            expected="hair masks that show the same hair from all cameras",
            mend="look at hair_*.png and at the cameras with `dynhair check`",
        )
    return HairPoints(torch.cat(found), torch.cat(colours))


def _shows_hair(
    points: Float[Tensor, "n 3"], scene: RestScene, share: float
) -> tuple[Bool[Tensor, " n"], Float[Tensor, "n 3"]]:
    """Whether each point is hair in at least ``share`` of the views that see it, and its mean colour in these."""
    views = scene.views
    size = points.new_tensor([views.hair.shape[2], views.hair.shape[1]])
    seen, hairy, colours = points.new_zeros(len(points)), points.new_zeros(len(points)), torch.zeros_like(points)
    for camera, rgb, hair, body in zip(views.cameras, views.rgb, views.hair, scene.body_depth, strict=True):
        pixels, depth = camera.project(points)
        inside = ((pixels >= 0) & (pixels < size)).all(1) & (depth > 0)
        column, row = pixels.nan_to_num().long().clamp_min(0).minimum(size.long() - 1).unbind(1)
        visible = inside & (depth < body[row, column] + BEHIND)
        shown = visible & (hair[row, column] > 0.5)
        seen += visible
        hairy += shown
        colours += shown[:, None] * rgb[row, column]
    enough = seen >= min(VIEWS, len(views))
    return enough & (hairy >= share * seen), colours / hairy.clamp_min(1)[:, None]
