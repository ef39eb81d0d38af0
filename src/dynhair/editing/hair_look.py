"""How posed strands look: which of the hairstyle's strands they are, how wide, and in which colours."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float, Int64
from torch import Tensor


@dataclass(frozen=True)
class HairLook:
    """What is drawn of ``m`` strands with ``n`` segments in all, strand by strand, root first.

    Attributes:
        ids: of each strand among the canonical ones, ascending; the same in every frame.
        nearest: for each of all canonical strands, the place among the ``m`` of the one that grows nearest to it; its
            own, if it is one of them.
        widths: of the strands, metres; they narrow towards the root.
        base_harmonic: colours' spherical harmonics of degree 0, see :mod:`dynhair.avatar.spherical_harmonics`.
        higher_harmonics: those of degrees 1 to 3.
    """

    ids: Int64[Tensor, " m"]
    nearest: Int64[Tensor, " k"]
    widths: Float[Tensor, " m"]
    base_harmonic: Float[Tensor, "1 3 n"]
    higher_harmonics: Float[Tensor, "15 3 n"]
