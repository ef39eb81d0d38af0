"""Measures one set of images of a segment: all figures of its frames, in order."""

from __future__ import annotations

from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.capture import Segment
from dynhair.evaluation.figures import (
    BOUNDARY_FIGURES,
    FLICKER,
    HAIR_FIGURES,
    MOTION,
    TEMPORAL_FIGURES,
    TORSO_FIGURES,
    FigureSums,
)
from dynhair.evaluation.flicker import TrueChange, hair_change
from dynhair.evaluation.hair_motion import HairMotion
from dynhair.evaluation.head_meter import Drawn, HeadMeter
from dynhair.evaluation.head_truth import HeadTruth, HeadTruths
from dynhair.evaluation.metrics import decibels, mean_similarity, silhouette, silhouette_iou, squared_error
from dynhair.evaluation.perception import Perception
from dynhair.evaluation.truth import TrueFrame
from dynhair.losses import ssim_map


class Meter:
    """Adds up frames, remembering the silhouettes of the last.

    Args:
        segment: of the capture.
        heads: its truth of the head.
        motion: compares strands; None where the capture holds no true ones.
        true_strands: of all frames of the segment, in the head's frame.

    Attributes:
        sums: of what was added.
    """

    def __init__(
        self,
        segment: Segment,
        heads: HeadTruths,
        motion: HairMotion | None,
        true_strands: Float[Tensor, "f m p 3"] | None,
    ) -> None:
        self.sums = FigureSums()
        self._head = HeadMeter(heads, self.sums)
        self._perception: Perception = heads.perception
        self._motion = motion
        self._true_strands = true_strands
        self._last: tuple[int, Bool[Tensor, "v h w"], Bool[Tensor, "v h w"]] | None = None
        self._last_rgb: Float[Tensor, "v h w 3"] | None = None
        if segment.split == "train":
            self.sums.explain("only every few frames of a training segment are evaluated", *TEMPORAL_FIGURES)
        if true_strands is None:
            self.sums.explain("the capture holds no true strands", MOTION)

    def add(
        self,
        truth: TrueFrame,
        head: HeadTruth,
        change: TrueChange | None,
        drawn: Drawn,
        strands: Float[Tensor, "n l 3"],
    ) -> None:
        """Measure a frame.

        Args:
            truth: of the frame.
            head: what it says of the head.
            change: of the truth's hair since the frame before, which was the last added; None if that is not known.
            drawn: the images.
            strands: the avatar's, in the head's frame, metres.
        """
        self.sums.add_frame(images=len(drawn.rgb))
        error, similarity = squared_error(drawn.rgb, truth.rgb), ssim_map(drawn.rgb, truth.rgb)
        self.sums.add("psnr", decibels(error))
        self.sums.add("ssim", mean_similarity(similarity))
        if truth.hair is None:
            needy = (*HAIR_FIGURES, "face_psnr", "face_ssim", *BOUNDARY_FIGURES, *TORSO_FIGURES)
            self.sums.explain("the capture has no hair masks", *needy)
        else:
            hair = silhouette(drawn.hair)
            self.sums.add("hair_psnr", decibels(error, truth.hair))
            self.sums.add("hair_ssim", mean_similarity(similarity, truth.hair))
            self.sums.add("hair_iou", silhouette_iou(hair, truth.hair))
            self._add_consecutive(truth.index, hair, truth.hair)
        if change is not None and self._last_rgb is not None:
            moved = hair_change(self._perception, self._last_rgb, drawn.rgb, change.region)
            self.sums.add(FLICKER, moved - change.distance)
        self._last_rgb = drawn.rgb
        self._head.add(truth, head, drawn, error, similarity)
        if self._motion is not None and self._true_strands is not None:
            self.sums.add_motion(*self._motion.errors(strands, self._true_strands[truth.index]))

    def _add_consecutive(self, index: int, hair: Bool[Tensor, "v h w"], truth: Bool[Tensor, "v h w"]) -> None:
        if self._last is not None and self._last[0] == index - 1:
            self.sums.add("hair_tiou", silhouette_iou(self._last[1], hair))
            self.sums.add("hair_tiou_truth", silhouette_iou(self._last[2], truth))
        self._last = index, hair, truth
