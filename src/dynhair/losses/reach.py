"""Hair that an image shows and the avatar does not: strands are drawn to where it must be. The paper has no such term.

The gradient of a silhouette reaches about a pixel, as far as a Gaussian does, and strands behind a shoulder get none at
all. So hair that swings far stays where it is, and hair that should lie on a shoulder rests behind it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int64
from pykdtree.kdtree import KDTree
from torch import Tensor

from dynhair.camera import Camera

MISSING = 0.3
"""Coverage that the avatar's hair must lack in a pixel before it counts: edges never agree to a pixel."""

LIFT = 0.005
"""Metres by which hair lies before the surface that is seen in its place."""

SURFACE = 0.5
"""Coverage above which a pixel shows head or body, whose depth is then known."""

NEAREST = 4
"""Points that a pixel draws to itself."""


def reach_loss(
    points: Float[Tensor, "p 3"],
    cameras: Sequence[Camera],
    missing: Float[Tensor, "v h w"],
    surface: Float[Tensor, "v h w"],
    depth: Float[Tensor, "v h w"],
    *,
    samples: int,
    generators: Sequence[torch.Generator],
) -> Float[Tensor, ""]:
    """Mean over pixels of the distance from missing hair to the strand points nearest to it, metres.

    A pixel's missing hair lies just before the surface that is drawn there or, where there is none, as far away as the
    strand point that is nearest to it in the image.

    Args:
        points: of strands, world, metres.
        cameras: of the views.
        missing: the hair's true coverage less the drawn one; it gets no gradient, and what is below `MISSING` is
            ignored.
        surface: drawn coverage by head and body.
        depth: of what is drawn, along the viewing axis, metres.
        samples: pixels drawn at random in each view, by how much is missing there; the rest is represented by them.
        generators: of random numbers, one a view, on the CPU.

    Returns:
        Zero where nothing is missing.
    """
    missing = torch.where(missing > MISSING, missing, 0.0).detach().cpu()
    total = points.new_zeros(())
    if len(points) == 0:
        return total
    for view, camera in enumerate(cameras):
        amount = float(missing[view].sum())
        if amount == 0:
            continue
        drawn = torch.multinomial(missing[view].flatten(), samples, replacement=True, generator=generators[view])
        rows, columns = (index.to(points.device) for index in (drawn // missing.shape[2], drawn % missing.shape[2]))
        w2c, intrinsics = camera.w2c.to(points), camera.K.to(points)
        seen = points @ w2c[:, :3].T + w2c[:, 3]
        with torch.no_grad():
            pixels = torch.stack([columns, rows], 1).to(points) + 0.5
            rays = (pixels - intrinsics[:2, 2]) / intrinsics.diagonal()[:2]
            beside = seen[_nearest(seen[:, :2] / seen[:, 2:], rays, 1)[:, 0], 2]
            on_surface = surface[view, rows, columns] > SURFACE
            away = torch.where(on_surface, depth[view, rows, columns].to(points) - LIFT, beside)
            goals = torch.cat([rays, torch.ones_like(rays[:, :1])], 1) * away[:, None]
            nearest = _nearest(seen, goals, min(NEAREST, len(points)))
        distance = (seen[nearest] - goals[:, None]).norm(dim=-1).mean()
        total = total + distance * (amount / missing[view].numel())
    return total / len(cameras)


def _nearest(points: Float[Tensor, "p d"], places: Float[Tensor, "s d"], count: int) -> Int64[Tensor, "s {count}"]:
    """Indices of the points nearest to each place; a tree finds them in a quarter of the time of all distances."""
    # What is not finite spoils the loss, and with it the step, in its own place, and not the search.
    tree, looked_at = (np.ascontiguousarray(torch.nan_to_num(rows).cpu().numpy()) for rows in (points, places))
    _, found = KDTree(tree).query(looked_at, k=count)
    return torch.from_numpy(found.astype(np.int64).reshape(len(places), count)).to(points.device)
