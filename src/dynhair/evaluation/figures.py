"""The figures of an evaluation: what each means, and their running means over images and frames."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.evaluation.edge_motion import EDGE, SMOOTHING, WINDOW
from dynhair.evaluation.hair_motion import NEAREST_POINTS, motion_explained
from dynhair.evaluation.metrics import PSNR_CEILING, SILHOUETTE_THRESHOLD
from dynhair.evaluation.perception import LEAST_FACE, PERCEPTION_STRIDE
from dynhair.evaluation.regions import BAND
from dynhair.evaluation.torso import BODY_FOLLOW, FAINT_HAIR, HAIR_MARGIN, LEAST_EDGES

MOTION = "hair_motion_explained"
FLICKER = "hair_tlpips_excess"
TEMPORAL_FIGURES = ("hair_tiou", "hair_tiou_truth", FLICKER)
HAIR_FIGURES = ("hair_psnr", "hair_ssim", "hair_iou", *TEMPORAL_FIGURES)
"""The figures of hair that need hair masks."""

SILHOUETTE_FIGURES = ("hair_iou", "hair_tiou")
"""The figures that need the hair's coverage in the method's own images."""

LPIPS_FIGURES = ("lpips", "face_lpips", FLICKER)
FACE_FIGURES = ("face_psnr", "face_ssim", "face_lpips")
BOUNDARY_FIGURES = ("boundary_psnr", "boundary_label_error")
TORSO_MOTION, TORSO_MOTION_TRUTH = "torso_motion", "torso_motion_truth"
TORSO_FIGURES = (TORSO_MOTION, TORSO_MOTION_TRUTH)

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
    FLICKER: "the paper's tLPIPS_ex: LPIPS (0.1, AlexNet) of the avatar's images in frames t and t + 1 of one camera, "
    "black outside the truth's hair masks of both frames, less that of the truth's images there; above 0 the avatar "
    "flickers, below it is stiff; mean over pairs",
    MOTION: "1 - mean |d - g| / mean |g| over frames and points of the true strands, in the head's frame: g is a "
    f"point's displacement from rest, d the avatar's, blended by inverse distance from its {NEAREST_POINTS} "
    "strand points nearest to that point at rest; 1 is the true motion, 0 a rigid hairstyle",
    "lpips": "learned perceptual distance of whole images in [0, 1] (LPIPS 0.1, AlexNet), lower is better; mean over "
    f"the images of one evaluated frame in {PERCEPTION_STRIDE}, from a segment's first",
    "face_psnr": "psnr over the face: pixels whose centre is in the convex hull of the frame's projected 3-D "
    "landmarks (66 of iBUG, brows to chin), in views from before the face, less the truth's hair silhouette; mean over "
    "the images that have any",
    "face_ssim": "the ssim map of the whole image averaged over the pixels of face_psnr; mean over the images that "
    "have any",
    "face_lpips": "lpips of the least square crop round the landmarks' hull, hair in it included, moved to lie in the "
    f"image; enlarged to {LEAST_FACE} pixels (bicubic) where it is smaller; the same crop of avatar and truth; mean "
    "over the images, among those of lpips, that show a face",
    "boundary_psnr": f"psnr over the pixels within {BAND:.2%} of the image's longer side of the edge of the truth's "
    "hair silhouette, on both sides, one pixel at least; mean over the images that have any",
    "boundary_label_error": "mean of |h - h*| and |b - b*|, each over the pixels of boundary_psnr: h and b are the "
    "avatar's visible coverage of hair and of head and body, h* the truth's hair mask and b* what else its mask "
    "covers, (mask - h*)+; mean over images",
    TORSO_MOTION: "pixels by which the avatar's torso has moved in its images since the segment's first frame: mean "
    "displacement across the edges of its own first image, mean over the images of later frames. Torso: the tracked "
    f"mesh's faces that follow the head by less than {BODY_FOLLOW:g}, projected in the first frame, less the hull of "
    f"the rest of the mesh in both frames, less pixels within {HAIR_MARGIN} of hair (coverage above {FAINT_HAIR:g}) in "
    f"the avatar's or the truth's images of both frames. Edges: luma, smoothed by a Gaussian of {SMOOTHING:g} pixel, "
    f"changes by more than {EDGE:g} a pixel; at least {LEAST_EDGES} in a view. Displacement: Lucas-Kanade with a "
    f"change of brightness, Gaussian window of {WINDOW:g} pixels",
    TORSO_MOTION_TRUTH: "the same of the truth's images over the same pixels: where the torso rests, what noise and "
    "shadows make of it",
}
"""What each figure means, in the order of reports."""

_NOT_SEEN = {
    FACE_FIGURES: "no evaluated image shows the face",
    BOUNDARY_FIGURES: "no evaluated image shows an edge of hair",
    TORSO_FIGURES: "no evaluated image shows edges of the torso in two frames",
}
"""Why figures have no samples where all that they need is there."""


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
    """Running sums in double precision: constant memory however many frames are added.

    Args:
        held_out: for each view whether training held it out.

    Attributes:
        frames: that were added.
        images: that were added.
        held_out: sums over the views held out alone; None where there are none.
    """

    def __init__(self, held_out: Sequence[bool] = ()) -> None:
        self.frames = 0
        self.images = 0
        self.held_out: FigureSums | None = FigureSums() if any(held_out) else None
        self._held_out_views = torch.tensor(list(held_out), dtype=torch.bool)
        self._sums: defaultdict[str, float] = defaultdict(float)
        self._samples: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}

    def add_frame(self, images: int) -> None:
        """Count one frame seen from ``images`` cameras."""
        self.frames += 1
        self.images += images
        if self.held_out is not None:
            self.held_out.add_frame(int(self._held_out_views.sum()))

    def add(self, name: str, values: Float[Tensor, " v"]) -> None:
        """Add one value a view; ``nan`` marks a view where the figure is not defined, and is left out."""
        defined = values[~values.isnan()].double()
        self._sums[name] += defined.sum().item()
        self._samples[name] += len(defined)
        if self.held_out is not None:
            self.held_out.add(name, values[self._held_out_views])

    def add_value(self, name: str, value: float) -> None:
        """Add what is of all views together; ``nan`` where the figure is not defined is left out."""
        if not math.isnan(value):
            self._sums[name] += value
            self._samples[name] += 1

    def add_motion(self, error: float, rigid_error: float) -> None:
        """Add one frame's mean errors of hair motion, the avatar's and a rigid hairstyle's, metres."""
        self._sums["error"] += error
        self._sums["rigid_error"] += rigid_error
        self._samples[MOTION] += 1

    def explain(self, reason: str, *names: str) -> None:
        """Say why these figures have no samples, should it stay so."""
        self._reasons.update(dict.fromkeys(names, reason))
        if self.held_out is not None:
            self.held_out.explain(reason, *names)

    def merge(self, other: FigureSums) -> None:
        """Add all that ``other`` has seen."""
        self.frames += other.frames
        self.images += other.images
        for name, value in other._sums.items():
            self._sums[name] += value
        self._samples.update(other._samples)
        self._reasons.update(other._reasons)
        if self.held_out is not None and other.held_out is not None:
            self.held_out.merge(other.held_out)

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
        return next((reason for names, reason in _NOT_SEEN.items() if name in names), "no evaluated image shows hair")
