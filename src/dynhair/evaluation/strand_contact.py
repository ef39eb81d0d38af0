"""What strands cannot do: enter head and body, and stretch."""

from __future__ import annotations

import math
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.strands import Obstacle, segment_lengths

LEAST_LENGTH = 1e-6
"""Metres; shorter canonical segments are left out, since any change of theirs is a large share."""


class PenetrationFigures(NamedTuple):
    """Over all points of all frames.

    Attributes:
        rate: share of the strand points that are inside the mesh; ``nan`` where no frame was seen.
        depth_mm: mean distance of these to the surface, millimetres; ``nan`` where none is inside.
    """

    rate: float
    depth_mm: float


class Penetration:
    """Adds up frames: ``rate = |{p : d(p) < 0}| / |{p}|``, ``depth = mean of -d(p) over d(p) < 0``.

    Roots are left out: they lie on the surface, where being inside is a matter of rounding.
    """

    def __init__(self) -> None:
        self._points, self._inside, self._depth = 0, 0, 0.0

    def add(self, strands: Float[Tensor, "n l 3"], mesh: Obstacle) -> None:
        """Add a frame.

        Args:
            strands: root first, metres.
            mesh: of head and body, in the strands' frame, such as a `MeshDistance`.
        """
        distance, _ = mesh.query(strands.detach()[:, 1:].flatten(0, 1))
        inside = distance[distance < 0]
        self._points += len(distance)
        self._inside += len(inside)
        self._depth -= inside.double().sum().item()

    def merge(self, other: Penetration) -> None:
        """Add all frames of ``other``."""
        self._points += other._points
        self._inside += other._inside
        self._depth += other._depth

    def figures(self) -> PenetrationFigures:
        """Take the figures of all that was added."""
        return PenetrationFigures(
            rate=self._inside / self._points if self._points else math.nan,
            depth_mm=1e3 * self._depth / self._inside if self._inside else math.nan,
        )


class Stretch:
    """Adds up frames: the root mean square over segments and frames of ``l / l_canonical - 1``.

    Args:
        canonical: strands at rest, metres.
    """

    def __init__(self, canonical: Float[Tensor, "n l 3"]) -> None:
        lengths = segment_lengths(canonical.detach().cpu().double())
        self._shape = canonical.shape
        self._counted = lengths > LEAST_LENGTH
        self._lengths = lengths[self._counted]
        self._sum, self._count = 0.0, 0

    def add(self, strands: Float[Tensor, "n l 3"]) -> None:
        """Add a frame.

        Args:
            strands: the canonical ones, deformed, in any frame that is rigid to the head.
        """
        if strands.shape != self._shape:
            raise DynhairError(f"strands of shape {list(strands.shape)}", expected=f"{list(self._shape)}, as at rest")
        lengths = segment_lengths(strands.detach().cpu().double())[self._counted]
        self._sum += (lengths / self._lengths - 1).square().sum().item()
        self._count += len(lengths)

    def merge(self, other: Stretch) -> None:
        """Add all frames of ``other``."""
        self._sum += other._sum
        self._count += other._count

    def rms(self) -> float:
        """The figure of all that was added; ``nan`` where there was nothing."""
        return math.sqrt(self._sum / self._count) if self._count else math.nan
