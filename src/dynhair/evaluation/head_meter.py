"""Measures the head in one set of images: face, edge of the hair, torso."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.evaluation.definitions import TORSO_MOTION, TORSO_MOTION_TRUTH
from dynhair.evaluation.figures import FigureSums
from dynhair.evaluation.head_truth import HeadTruth, HeadTruths
from dynhair.evaluation.metrics import decibels, label_error, mean_similarity
from dynhair.evaluation.torso import TorsoMotion, mean_motion, without_hair
from dynhair.evaluation.truth import TrueFrame

NO_HAIR_COVERAGE = "the method does not tell hair from the rest of its images"


@dataclass(frozen=True)
class Drawn:
    """An avatar in one frame, on the CPU.

    Attributes:
        rgb: images in [0, 1].
        hair: visible coverage of hair; None where the method does not tell hair from the rest.
        body: visible coverage of head and body; None where it does not tell these.
    """

    rgb: Float[Tensor, "v h w 3"]
    hair: Float[Tensor, "v h w"] | None
    body: Float[Tensor, "v h w"] | None


class HeadMeter:
    """Adds a segment's frames to sums, from its first.

    Args:
        truths: what the images are held against.
        sums: of the segment.
    """

    def __init__(self, truths: HeadTruths, sums: FigureSums) -> None:
        self._truths, self._sums = truths, sums
        self._first: tuple[TorsoMotion, tuple[Float[Tensor, "v h w"], ...]] | None = None
        for name, reason in truths.missing.items():
            sums.explain(reason, name)

    def add(
        self,
        truth: TrueFrame,
        head: HeadTruth,
        drawn: Drawn,
        error: Float[Tensor, "v h w"],
        similarity: Float[Tensor, "v h w 3"],
    ) -> None:
        """Measure a frame.

        Args:
            truth: of the frame.
            head: what it says of the head.
            drawn: the images.
            error: their squared error, mean over channels.
            similarity: their structural similarity to the truth.
        """
        if truth.hair is None or truth.hair_coverage is None:
            return
        if head.face is not None:
            face = head.face.pixels & ~truth.hair
            self._sums.add("face_psnr", decibels(error, face))
            self._sums.add("face_ssim", mean_similarity(similarity, face))
        self._add_boundary(truth, head, drawn, error)
        self._add_torso(head, drawn, truth.hair_coverage)

    def _add_boundary(self, truth: TrueFrame, head: HeadTruth, drawn: Drawn, error: Float[Tensor, "v h w"]) -> None:
        if head.band is None or truth.hair_coverage is None or truth.body_coverage is None:
            return
        self._sums.add("boundary_psnr", decibels(error, head.band))
        if drawn.hair is None:
            self._sums.explain(NO_HAIR_COVERAGE, "boundary_label_error")
            return
        if drawn.body is None:
            self._sums.explain("the avatar does not tell head and body from the background", "boundary_label_error")
            return
        hair = label_error(drawn.hair, truth.hair_coverage, head.band)
        body = label_error(drawn.body, truth.body_coverage, head.band)
        self._sums.add("boundary_label_error", (hair + body) / 2)

    def _add_torso(self, head: HeadTruth, drawn: Drawn, true_hair: Float[Tensor, "v h w"]) -> None:
        coverages = (true_hair,) if drawn.hair is None else (drawn.hair, true_hair)
        if self._first is None:
            if self._truths.torso is not None:
                self._first = TorsoMotion(self._truths.torso, drawn.rgb), coverages
            return
        if head.torso is None or head.torso_motion is None:
            return
        motion, first_coverages = self._first
        visible = without_hair(head.torso, (*first_coverages, *coverages))
        both = torch.stack([mean_motion(motion.distances(drawn.rgb), visible), mean_motion(head.torso_motion, visible)])
        both[:, both.isnan().any(dim=0)] = torch.nan  # so that the two are of the same images
        self._sums.add(TORSO_MOTION, both[0])
        self._sums.add(TORSO_MOTION_TRUTH, both[1])
