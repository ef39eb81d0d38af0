"""The canonical hairstyle as edits find it and leave it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.editing.hair_look import HairLook
from dynhair.editing.regions import parse_region
from dynhair.errors import DynhairError
from dynhair.strands import strand_lengths


@dataclass(frozen=True)
class CanonicalHair:
    """A hairstyle at rest. All of its strands keep their places, also those that edits remove or shorten.

    Attributes:
        strands: at rest and uncut, head frame, metres.
        kept: those that no edit has removed.
        lengths: arc length that is left of each from the root, metres.
        widths: of each, metres.
        base_harmonic: colours of the uncut strands' ``s = n * (l - 1)`` segments: harmonics of degree 0.
        higher_harmonics: those of degrees 1 to 3.
    """

    strands: Float[Tensor, "n l 3"]
    kept: Bool[Tensor, " n"]
    lengths: Float[Tensor, " n"]
    widths: Float[Tensor, " n"]
    base_harmonic: Float[Tensor, "1 3 s"]
    higher_harmonics: Float[Tensor, "15 3 s"]

    @classmethod
    def of(cls, strands: Float[Tensor, "n l 3"], look: HairLook) -> CanonicalHair:
        """The hairstyle before all edits.

        Args:
            strands: at rest, head frame, metres.
            look: of all of them.
        """
        kept = torch.ones(len(strands), dtype=torch.bool, device=strands.device)
        lengths = strand_lengths(strands)
        return cls(strands, kept, lengths, look.widths, look.base_harmonic, look.higher_harmonics)

    def region(self, region: str) -> Bool[Tensor, " n"]:
        """The strands of a region, see :func:`~dynhair.editing.regions.parse_region`, whether they are kept or not.

        Raises:
            DynhairError: there are none, or not so many.
        """
        chosen = parse_region(region).select(self.strands[:, 0])
        if not chosen.any():
            low, high = (bound.tolist() for bound in self.strands[:, 0].aminmax(dim=0))
            reach = ", ".join(f"{a:.3f} to {b:.3f}" for a, b in zip(low, high, strict=True))
            raise DynhairError(
                f"no strand is rooted in the region {region}", expected=f"roots with x, y, z from {reach} m"
            )
        return chosen

    def segments_of(self, chosen: Bool[Tensor, " n"]) -> Bool[Tensor, " s"]:
        """The segments of some of the strands."""
        return chosen.repeat_interleave(self.strands.shape[1] - 1)
