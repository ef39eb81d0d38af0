"""Figures by networks that judge how alike images look: the truth's part once a frame, and a meter for each head."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from dynhair.evaluation.definitions import FLICKER, LPIPS_FIGURES, STILL_CHANGE
from dynhair.evaluation.face import FaceRegion
from dynhair.evaluation.figures import FigureSums
from dynhair.evaluation.flicker import TrueChange, TrueFlicker, hair_change
from dynhair.evaluation.perception import PERCEPTION_STRIDE, Perception, Seen
from dynhair.evaluation.truth import TrueFrame


@dataclass(frozen=True)
class TrueLook:
    """One frame of the truth as networks see it.

    Attributes:
        face: where the views show the face; None where that is not known.
        seen: of the whole images and the faces; None in frames that are not compared.
        change: of the hair since the frame before; None if that is not known.
    """

    face: FaceRegion | None
    seen: Seen | None
    change: TrueChange | None


class TrueLooks:
    """The truth of one segment, taken frame by frame from its first.

    Args:
        perception: for LPIPS.
        still: how many frames the segment begins with before anything moves.
    """

    def __init__(self, perception: Perception, still: int) -> None:
        self.perception = perception
        self._flicker = TrueFlicker(perception, still)
        self._frames = 0

    def frame(self, truth: TrueFrame, face: FaceRegion | None) -> TrueLook:
        """Look at the next frame that is evaluated."""
        looked_at = self.perception.distance is not None and self._frames % PERCEPTION_STRIDE == 0
        self._frames += 1
        seen = self.perception.see(truth.rgb, face) if looked_at else None
        return TrueLook(face, seen, self._flicker.change(truth))


class LooksMeter:
    """Adds a segment's frames to sums, from its first.

    Args:
        truths: what the images are held against.
        sums: of the segment.
    """

    def __init__(self, truths: TrueLooks, sums: FigureSums) -> None:
        self._perception, self._sums = truths.perception, sums
        self._last: Float[Tensor, "v h w 3"] | None = None
        if truths.perception.distance is None:
            sums.explain(truths.perception.description, *LPIPS_FIGURES)

    def add(self, truth: TrueLook, rgb: Float[Tensor, "v h w 3"]) -> None:
        """Measure a frame's images, in [0, 1]."""
        perception = self._perception
        if truth.seen is not None:
            whole, faces = perception.compare(perception.see(rgb, truth.face), truth.seen)
            self._sums.add("lpips", whole)
            self._sums.add("face_lpips", faces)
        if truth.change is not None and self._last is not None:
            moved = hair_change(perception, self._last, rgb, truth.change.region)
            self._sums.add(FLICKER, moved - truth.change.distance)
            if truth.change.still:
                self._sums.add(STILL_CHANGE, truth.change.distance)
        self._last = rgb
