"""The figures of an evaluation: what each means, and their running means over images and frames."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jaxtyping import Float
from torch import Tensor

from dynhair.evaluation.hair_motion import NEAREST_POINTS, motion_explained
from dynhair.evaluation.metrics import PSNR_CEILING, SILHOUETTE_THRESHOLD

MOTION = "hair_motion_explained"
TEMPORAL_FIGURES = ("hair_tiou", "hair_tiou_truth")
HAIR_FIGURES = ("hair_psnr", "hair_ssim", "hair_iou", *TEMPORAL_FIGURES)
"""The figures that need hair masks."""

DEFINITIONS: Mapping[str, str] = {
    "psnr": "dB, -10 log10(MSE) over all pixels and channels of the sRGB image in [0, 1], "
    f"at most {PSNR_CEILING:g}; mean over images",
    "ssim": "structural similarity, Gaussian window of 11 pixels, sigma 1.5, K1 0.01, K2 0.03, over channels and "
    "all pixels whose window is inside the image; mean over images",
    "hair_psnr": "psnr over the pixels of the truth's hair silhouette; mean over the images that have one",
    "hair_ssim": "the ssim map of the whole image averaged over those of its pixels in the truth's hair silhouette; "
    "mean over the images that have one",
    "hair_iou": "intersection over union of the avatar's and the truth's hair silhouettes "
    f"(pixels with coverage above {SILHOUETTE_THRESHOLD:g}); mean over images",
    "hair_tiou": "intersection over union of the avatar's hair silhouettes in frames t and t + 1 of one camera; "
    "mean over pairs",
    "hair_tiou_truth": "the same of the truth's hair silhouettes, to which hair_tiou should come close",
    MOTION: "1 - mean |d - g| / mean |g| over frames and points of the true strands, in the head's frame: g is a "
    f"point's displacement from rest, d the avatar's, blended by inverse distance from its {NEAREST_POINTS} "
    "strand points nearest to that point at rest; 1 is the true motion, 0 a rigid hairstyle",
}
"""What each figure means, in the order of reports."""


@dataclass(frozen=True)
class Figures:
    """Means over some frames and all their views.

    Attributes:
        values: by name of figure; None where it could not be measured.
        reasons: why, for each that is None.
        samples: over how many images, pairs of images or (for the motion) frames each was averaged.
        frames: frames evaluated.
        images: images evaluated, one for each frame and view.
    """

    values: Mapping[str, float | None]
    reasons: Mapping[str, str]
    samples: Mapping[str, int]
    frames: int
    images: int

    @classmethod
    def unmeasured(cls, reason: str) -> Figures:
        """Leave out all figures for one reason."""
        return cls(dict.fromkeys(DEFINITIONS), dict.fromkeys(DEFINITIONS, reason), dict.fromkeys(DEFINITIONS, 0), 0, 0)

    def to_json(self) -> dict[str, Any]:
        """Lay out the figures by name, then their counts and reasons."""
        return {
            **self.values,
            "frames": self.frames,
            "images": self.images,
            "samples": dict(self.samples),
            "reasons": dict(self.reasons),
        }


class FigureSums:
    """Running sums in double precision: constant memory however many frames are added."""

    def __init__(self) -> None:
        self.frames = 0
        self.images = 0
        self._sums: defaultdict[str, float] = defaultdict(float)
        self._samples: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}

    def add_frame(self, images: int) -> None:
        """Count one frame seen from ``images`` cameras."""
        self.frames += 1
        self.images += images

    def add(self, name: str, values: Float[Tensor, " v"]) -> None:
        """Add one value a view; ``nan`` marks a view where the figure is not defined, and is left out."""
        defined = values[~values.isnan()].double()
        self._sums[name] += defined.sum().item()
        self._samples[name] += len(defined)

    def add_motion(self, error: float, rigid_error: float) -> None:
        """Add one frame's mean errors of hair motion, the avatar's and a rigid hairstyle's, metres."""
        self._sums["error"] += error
        self._sums["rigid_error"] += rigid_error
        self._samples[MOTION] += 1

    def explain(self, reason: str, *names: str) -> None:
        """Say why these figures have no samples, should it stay so."""
        self._reasons.update(dict.fromkeys(names, reason))

    def merge(self, other: FigureSums) -> None:
        """Add all that ``other`` has seen."""
        self.frames += other.frames
        self.images += other.images
        for name, value in other._sums.items():
            self._sums[name] += value
        self._samples.update(other._samples)
        self._reasons.update(other._reasons)

    def figures(self) -> Figures:
        """Take the means of all that was added."""
        means = {name: self._mean(name) for name in DEFINITIONS}
        reasons = {
            name: self._reasons.get(name, self._default_reason(name)) for name, mean in means.items() if mean is None
        }
        samples = {name: self._samples[name] for name in DEFINITIONS}
        return Figures(means, reasons, samples, self.frames, self.images)

    def _mean(self, name: str) -> float | None:
        count = self._samples[name]
        if not count:
            return None
        if name != MOTION:
            return self._sums[name] / count
        explained = motion_explained(self._sums["error"] / count, self._sums["rigid_error"] / count)
        return None if math.isnan(explained) else explained

    def _default_reason(self, name: str) -> str:
        if self._samples[name]:
            return "the truth's hair stands still in these frames"
        return "no evaluated image shows hair"
