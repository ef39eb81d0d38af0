"""A surface that a network describes on a tetrahedral grid: the signed distance and the place of every grid vertex."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from dynhair.avatar.encoding import CANONICAL_UNIT, ENCODING_FREQUENCIES, encoded_size, positional_encoding
from dynhair.avatar.mlp import PointMLP
from dynhair.errors import DynhairError
from dynhair.mesh import Surface, TetrahedralGrid, marching_tetrahedra

# A tetrahedron of the grid is 0.7 cubes high: vertices that move by less than half of that cannot turn one inside out.
LARGEST_SHIFT = 0.2
SURROUNDINGS = 2  # layers of tetrahedra around those that the surface crosses
_FAR, _EDGE, _WITHIN = range(3)  # where the network is not evaluated, where that begins, and where there is room yet


class PointField(NamedTuple):
    """What the network says of points.

    Attributes:
        sdf: signed distance, metres, negative inside.
        shift: displacement of a grid vertex, metres.
    """

    sdf: Float[Tensor, " n"]
    shift: Float[Tensor, "n 3"]


class Extraction(NamedTuple):
    """A surface and what it was extracted from.

    Attributes:
        surface: whose parents count the evaluated grid vertices.
        field: what the network says of those.
        rows: their indices in the grid.
        tetrahedra: those among them, as places in ``rows``.
    """

    surface: Surface
    field: PointField
    rows: Int[Tensor, " n"]
    tetrahedra: Int[Tensor, "t 4"]


class NeuralSurface(nn.Module):
    """The geometry MLP of the mesh head and the grid that it lives on (paper, appendix A; Deep Marching Tetrahedra).

    The network is evaluated where the surface is: at the grid vertices within a few tetrahedra of it. Where the surface
    has come to the edge of those, it is looked for in the whole grid again. A new piece of surface that appears far
    from all others is found by :meth:`refresh` alone.

    Args:
        grid: head frame, metres.
        first: signed distance of the shape that it begins as, at the grid's vertices, metres.
        width: of the hidden layers.
        layers: their number.
    """

    near: Tensor
    places: Tensor
    first: Tensor
    _tetrahedra: Tensor

    def __init__(self, grid: TetrahedralGrid, first: Float[Tensor, " n"], width: int, layers: int) -> None:
        super().__init__()
        self.network = PointMLP(encoded_size(3, ENCODING_FREQUENCIES), 0, (width,) * layers, 1 + 3)
        self.spacing = grid.spacing
        self.register_buffer("places", grid.vertices, persistent=False)
        self.register_buffer("first", first.clone())
        self.register_buffer("_tetrahedra", grid.tetrahedra, persistent=False)
        self.register_buffer("near", torch.full((len(grid.vertices),), _WITHIN, dtype=torch.uint8))
        self._near_rows: tuple[Tensor, Tensor] | None = None
        self.register_load_state_dict_post_hook(lambda _module, _keys: self._forget_rows())

    def at(self, points: Float[Tensor, "n 3"]) -> PointField:
        """What the network says of points of the head frame, metres."""
        code = positional_encoding(points / CANONICAL_UNIT, ENCODING_FREQUENCIES)
        sdf, shift = self.network(code, points.new_empty(0)).split([1, 3], dim=1)
        return PointField(CANONICAL_UNIT * sdf[:, 0], LARGEST_SHIFT * self.spacing * shift.tanh())

    def forward(self) -> Extraction:
        """The surface, as far as it lies where the network is evaluated."""
        found = self._extracted()
        parents = found.surface.parents
        if not len(parents) or (self.near[found.rows][parents] == _EDGE).any():
            self.refresh()
            found = self._extracted()
        return found

    @torch.no_grad()
    def refresh(self) -> None:
        """Look for the surface in the whole grid.

        Raises:
            DynhairError: there is none.
        """
        inside = self.at(self.places).sdf < 0
        reached = self._tetrahedra[crossed(inside, self._tetrahedra)]
        if not len(reached):
            raise DynhairError(
                "the mesh head has no surface left",
                expected="masks that show a person in all views",
                mend="look at the masks of the training segments: `dynhair check` draws them",
            )
        layers = torch.zeros_like(self.near)
        for _ in range(SURROUNDINGS + 1):
            chosen = layers > 0
            chosen[reached.flatten().long()] = True
            layers += chosen
            reached = self._tetrahedra[touched(chosen, self._tetrahedra)]
        self.near = layers.clamp_max(_WITHIN)
        self._forget_rows()

    def _extracted(self) -> Extraction:
        rows, tetrahedra = self._rows()
        places = self.places[rows]
        field = self.at(places)
        surface = marching_tetrahedra(places + field.shift, field.sdf, tetrahedra)
        return Extraction(surface, field, rows, tetrahedra)

    def _rows(self) -> tuple[Tensor, Tensor]:
        """Indices of the grid vertices near the surface, and the tetrahedra among them."""
        if self._near_rows is None:
            near = self.near != _FAR
            rows = near.nonzero().squeeze(1)
            place = torch.zeros(len(near), dtype=torch.int32, device=rows.device)
            place[rows] = torch.arange(len(rows), dtype=torch.int32, device=rows.device)
            whole = self._tetrahedra[enclosed(near, self._tetrahedra)]
            self._near_rows = rows, place[whole.long()]
        return self._near_rows

    def _forget_rows(self) -> None:
        self._near_rows = None


def crossed(inside: Bool[Tensor, " n"], tetrahedra: Int[Tensor, "t 4"]) -> Int[Tensor, " k"]:
    """Tetrahedra with corners inside and outside."""
    a, b, c, d = _corners(inside, tetrahedra)
    return ((a != b) | (a != c) | (a != d)).nonzero().squeeze(1)


def touched(chosen: Bool[Tensor, " n"], tetrahedra: Int[Tensor, "t 4"]) -> Int[Tensor, " k"]:
    """Tetrahedra with a chosen corner."""
    a, b, c, d = _corners(chosen, tetrahedra)
    return (a | b | c | d).nonzero().squeeze(1)


def enclosed(chosen: Bool[Tensor, " n"], tetrahedra: Int[Tensor, "t 4"]) -> Int[Tensor, " k"]:
    """Tetrahedra of chosen corners alone."""
    a, b, c, d = _corners(chosen, tetrahedra)
    return (a & b & c & d).nonzero().squeeze(1)


def _corners(chosen: Tensor, tetrahedra: Tensor) -> tuple[Tensor, ...]:
    # index_select and columns take a fifth of the time of chosen[tetrahedra] with any and all.
    return chosen.index_select(0, tetrahedra.flatten()).reshape(-1, 4).unbind(1)
