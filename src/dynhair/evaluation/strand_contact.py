"""What strands cannot do: enter head and body, and stretch."""

from __future__ import annotations

import math
from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.strands import Obstacle, segment_lengths


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
    """Adds up frames: ``sqrt(sum (l - l_0)^2 / sum l_0^2)`` over segments of length l, canonically l_0, and frames.

    This is the paper's elastic loss relative to that of strands drawn together to a point; strands that are all longer
    by a share score that share. A mean of ``(l / l_0 - 1)^2`` would be a matter of the shortest segments: a tenth of a
    millimetre at a root that grows by as much would outweigh a hundred segments of a centimetre.

    Args:
        canonical: strands at rest, metres.

    Raises:
        DynhairError: they have no length.
    """

    def __init__(self, canonical: Float[Tensor, "n l 3"]) -> None:
        self._lengths = segment_lengths(canonical.detach().cpu().double())
        self._squared = self._lengths.square().sum().item()
        if not self._squared > 0:
            raise DynhairError("the canonical strands have no length")
        self._change, self._frames = 0.0, 0

    def add(self, strands: Float[Tensor, "n l 3"]) -> None:
        """Add a frame.

        Args:
            strands: the canonical ones, deformed, in any frame that is rigid to the head.
        """
        lengths = segment_lengths(strands.detach().cpu().double())
        if lengths.shape != self._lengths.shape:
            raise DynhairError(
                f"there are {len(lengths)} strands of {lengths.shape[1] + 1} points",
                expected=f"the {len(self._lengths)} of {self._lengths.shape[1] + 1} that there are at rest",
            )
        self._change += (lengths - self._lengths).square().sum().item()
        self._frames += 1

    def merge(self, other: Stretch) -> None:
        """Add all frames of ``other``, which has the same canonical strands."""
        self._change += other._change
        self._frames += other._frames

    def rms(self) -> float:
        """The figure of all that was added; ``nan`` where there was nothing."""
        return math.sqrt(self._change / (self._squared * self._frames)) if self._frames else math.nan
