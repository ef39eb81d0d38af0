"""Measures one set of images of a segment, pixel by pixel: figures of the whole, of the hair, of the head."""

from __future__ import annotations

from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.evaluation.definitions import (
    BOUNDARY_FIGURES,
    HAIR_FIGURES,
    SILHOUETTE_FIGURES,
    STILL_OVERLAP,
    TORSO_FIGURES,
)
from dynhair.evaluation.figures import FigureSums
from dynhair.evaluation.head_meter import NO_HAIR_COVERAGE, Drawn, HeadMeter
from dynhair.evaluation.head_truth import HeadTruth, HeadTruths
from dynhair.evaluation.metrics import decibels, mean_similarity, silhouette, silhouette_iou, squared_error
from dynhair.evaluation.series import Series
from dynhair.evaluation.truth import TrueFrame
from dynhair.losses import ssim_map


class Meter:
    """Adds up frames, remembering the silhouettes of the last.

    Args:
        sums: of the segment.
        series: of the segment.
        heads: the segment's truth of the head.
        still: how many frames the segment begins with before anything moves.
    """

    def __init__(self, sums: FigureSums, series: Series, heads: HeadTruths, still: int) -> None:
        self._sums, self._series, self._still = sums, series, still
        self._head = HeadMeter(heads, sums)
        self._last: tuple[int, Bool[Tensor, "v h w"]] | None = None
        self._last_true: tuple[int, Bool[Tensor, "v h w"]] | None = None

    def add(self, truth: TrueFrame, head: HeadTruth, drawn: Drawn) -> None:
        """Measure a frame.

        Args:
            truth: of the frame.
            head: what it says of the head.
            drawn: the images.
        """
        self._sums.add_frame(images=len(drawn.rgb))
        error, similarity = squared_error(drawn.rgb, truth.rgb), ssim_map(drawn.rgb, truth.rgb)
        self._sums.add("psnr", decibels(error))
        self._sums.add("ssim", mean_similarity(similarity))
        if truth.hair is None:
            needy = (*HAIR_FIGURES, "face_psnr", "face_ssim", *BOUNDARY_FIGURES, *TORSO_FIGURES)
            self._sums.explain("the capture has no hair masks", *needy)
        else:
            self._sums.add("hair_psnr", decibels(error, truth.hair))
            self._sums.add("hair_ssim", mean_similarity(similarity, truth.hair))
            self._add_silhouettes(truth.index, drawn, truth.hair)
        self._head.add(truth, head, drawn, error, similarity)

    def _add_silhouettes(self, index: int, drawn: Drawn, truth: Bool[Tensor, "v h w"]) -> None:
        if index < self._still and self._last_true is not None:
            self._sums.add(STILL_OVERLAP, silhouette_iou(self._last_true[1], truth))
        self._last_true = self._add_overlap("hair_tiou_truth", self._last_true, index, truth)
        if drawn.hair is None:
            self._sums.explain(NO_HAIR_COVERAGE, *SILHOUETTE_FIGURES)
            return
        hair = silhouette(drawn.hair)
        self._add("hair_iou", index, silhouette_iou(hair, truth))
        self._last = self._add_overlap("hair_tiou", self._last, index, hair)

    def _add_overlap(
        self, name: str, last: tuple[int, Bool[Tensor, "v h w"]] | None, index: int, hair: Bool[Tensor, "v h w"]
    ) -> tuple[int, Bool[Tensor, "v h w"]]:
        """Compare a silhouette with that of the frame before, if that was evaluated."""
        if last is not None and last[0] == index - 1:
            self._add(name, index, silhouette_iou(last[1], hair))
        return index, hair

    def _add(self, name: str, index: int, values: Float[Tensor, " v"]) -> None:
        """Add a figure that is also followed over time."""
        self._sums.add(name, values)
        self._series.record(name, index, values.nanmean().item())
