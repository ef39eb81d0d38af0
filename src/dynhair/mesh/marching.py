"""From a signed distance at the vertices of tetrahedra to the triangles of its zero level."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import torch
from jaxtyping import Float, Int, Int64
from torch import Tensor

NEGLIGIBLE_DIFFERENCE = 1e-6
"""Metres. An edge whose ends differ by less is cut as if they differed by this, so that the gradient stays finite."""

# A tetrahedron is looked at with its inside corners first, after an even permutation, which keeps it positive. The
# triangles then depend on the number of inside corners alone: each corner of theirs is an edge (inside, outside).
_TRIANGLES = {
    1: (((0, 1), (0, 2), (0, 3)),),
    2: (((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2))),
    3: (((0, 3), (1, 3), (2, 3)),),
}


@dataclass(frozen=True)
class Surface:
    """The zero level of a signed distance.

    Attributes:
        vertices: positions, one on each edge of the grid that crosses the surface; differentiable in the grid's
            positions and signed distances.
        faces: triangles, counter-clockwise seen from outside.
        parents: the ends of each vertex's edge: the grid vertex inside, then the one outside.
        weights: of the two, not negative, with sum 1; differentiable in the signed distances.
    """

    vertices: Float[Tensor, "v 3"]
    faces: Int64[Tensor, "f 3"]
    parents: Int64[Tensor, "v 2"]
    weights: Float[Tensor, "v 2"]

    def interpolate(self, values: Float[Tensor, "n c"]) -> Float[Tensor, "v c"]:
        """Carry an attribute of the grid's vertices to those of the surface."""
        return _interpolate(values, self.parents, self.weights)


def marching_tetrahedra(
    positions: Float[Tensor, "n 3"], sdf: Float[Tensor, " n"], tetrahedra: Int[Tensor, "t 4"]
) -> Surface:
    """Extract the surface where a signed distance, linear within each tetrahedron, is zero.

    Marching tetrahedra (Doi and Koide 1991), made differentiable as in DMTet (Shen et al. 2021). A distance of exactly
    zero counts as outside: the surface then passes through that grid vertex, with triangles that have no area. The
    surface is closed, every edge in two triangles, unless it leaves the grid.

    Args:
        positions: of the grid's vertices, metres.
        sdf: their signed distances, metres, negative inside.
        tetrahedra: positively oriented indices of vertices.

    Returns:
        The surface; without vertices and faces where no sign changes.
    """
    inside = sdf.detach() < 0
    # index_select and comparisons of columns take a fifth of the time of inside[tetrahedra] with any and all.
    a, b, c, d = inside.index_select(0, tetrahedra.flatten()).reshape(-1, 4).unbind(1)
    crossed = tetrahedra.index_select(0, ((a != b) | (a != c) | (a != d)).nonzero().squeeze(1)).long()
    corners_inside = inside[crossed]
    order = torch.tensor(_ARRANGEMENTS, device=sdf.device)[_codes(corners_inside)]
    arranged, counts = crossed.gather(1, order), corners_inside.sum(1)

    cut_edges = torch.cat(
        [arranged[counts == count][:, triangles].flatten(0, 1) for count, triangles in _TRIANGLES.items()]
    )
    keys, faces = torch.unique(cut_edges[..., 0] * len(sdf) + cut_edges[..., 1], return_inverse=True)
    parents = torch.stack([keys // len(sdf), keys % len(sdf)], dim=1)
    within, without = sdf.index_select(0, parents[:, 0]), sdf.index_select(0, parents[:, 1])
    outer_weight = -within / (without - within).clamp_min(NEGLIGIBLE_DIFFERENCE)
    weights = torch.stack([1 - outer_weight, outer_weight], dim=1)
    return Surface(_interpolate(positions, parents, weights), faces, parents, weights)


def _interpolate(values: Tensor, parents: Tensor, weights: Tensor) -> Tensor:
    first, second = (values.index_select(0, ends) for ends in parents.unbind(1))
    return weights[:, :1] * first + weights[:, 1:] * second


def _codes(inside: Tensor) -> Tensor:
    """Which corners are inside, as a number: bit i for corner i."""
    return (inside * torch.tensor([1, 2, 4, 8], device=inside.device)).sum(1)


def _inside_first(code: int) -> tuple[int, ...]:
    """An even permutation of a tetrahedron's corners that puts those inside first."""
    count = code.bit_count()
    for order in permutations(range(4)):
        inversions = sum(order[i] > order[j] for i in range(4) for j in range(i + 1, 4))
        if inversions % 2 == 0 and all(code >> corner & 1 for corner in order[:count]):
            return order
    raise AssertionError("every choice of corners can be put first")


_ARRANGEMENTS = [_inside_first(code) for code in range(16)]
