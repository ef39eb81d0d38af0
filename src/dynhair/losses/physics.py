"""What strands cannot do: stretch, and enter the head (paper, "Geometric losses").

Both losses are squares of lengths, here metres. A weight for another unit of length becomes one for metres when it is
divided by the square of that unit in metres: the paper's elastic weight of 500 for canonical units of 0.15 m is
500 / 0.15^2 = 22,000.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.strands import MeshDistance, segment_lengths
from dynhair.strands.collision import Nearest


def elastic_loss(posed: Float[Tensor, "*b n l 3"], rest: Float[Tensor, "n l 3"]) -> Float[Tensor, ""]:
    """The paper's ``L_elastic``: squared changes of segment length, summed and divided by N L.

    Args:
        posed: deformed strands, metres, in any frame that is rigid to the head; averaged over leading dimensions.
        rest: canonical strands, metres.
    """
    stretch = segment_lengths(posed) - segment_lengths(rest)
    return stretch.square().sum() / max(posed[..., 0].numel(), 1)


def sample_strand_points(
    strands: Float[Tensor, "n l 3"], count: int = 10_000, *, generator: torch.Generator
) -> Float[Tensor, "p 3"]:
    """Draw different points of strands at random, all of them if there are fewer than ``count``.

    Roots are left out: they lie on the surface, where being inside is a matter of rounding.

    Args:
        strands: polylines.
        count: at most this many points.
        generator: of random numbers, on the CPU.
    """
    points = strands[:, 1:].flatten(0, 1)
    if len(points) <= count:
        return points
    return points[torch.randperm(len(points), generator=generator)[:count].to(points.device)]


def penetration_loss(
    points: Float[Tensor, "p 3"], mesh: MeshDistance, counted: Bool[Tensor, " f"] | None = None
) -> Float[Tensor, ""]:
    """The paper's ``L_penetr``: mean squared depth of the points that are inside the head.

    The gradient pulls each inside point straight to the surface point nearest to it, held fixed: the exact gradient of
    the squared distance.

    Args:
        points: strand points, metres, in the mesh's frame.
        mesh: the head, or the head with the upper body.
        counted: the faces that points are kept in front of; a point that is nearest to another one does not count.
            Those of the head make the paper's form of a mesh of the whole upper body. All if not given.

    Returns:
        Mean squared distance to the surface over the inside points, square metres; zero if there are none.
    """
    return depth_loss(points, mesh.nearest(points), counted)


def depth_loss(
    points: Float[Tensor, "p 3"], nearest: Nearest, counted: Bool[Tensor, " f"] | None = None
) -> Float[Tensor, ""]:
    """:func:`penetration_loss` of points of which it is known already what is nearest to them.

    Args:
        points: strand points, metres, in the mesh's frame.
        nearest: what of the mesh is nearest to each.
        counted: the faces that points are kept in front of.
    """
    inside = nearest.distance < 0
    if counted is not None:
        inside = inside & counted[nearest.face.long()]
    inside = inside.to(points)
    depth = (points - nearest.position.to(points)).square().sum(dim=-1)
    return (inside * depth).sum() / inside.sum().clamp_min(1)
