"""All that is measured in a segment: the truth's part once a frame, and a meter for each head held against it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack, Segment
from dynhair.evaluation.appearance import VGG_FIGURES, Appearance, AppearanceMeter, AppearanceTruths, TrueAppearance
from dynhair.evaluation.cost import Stopwatch
from dynhair.evaluation.definitions import FID_FIGURES, MOTION_FIGURES, TEMPORAL_FIGURES
from dynhair.evaluation.fid import FidSums
from dynhair.evaluation.figures import FigureSums
from dynhair.evaluation.head_meter import Drawn
from dynhair.evaluation.head_truth import HeadTruth, HeadTruths
from dynhair.evaluation.looks import LooksMeter, TrueLook, TrueLooks
from dynhair.evaluation.meter import Meter
from dynhair.evaluation.motion_meter import NOT_CONSECUTIVE, MotionMeter, PosedHair
from dynhair.evaluation.series import Series
from dynhair.evaluation.stillness import still_frames
from dynhair.evaluation.true_motion import HeadObstacle, RestingHair, TrueMotion, in_head
from dynhair.evaluation.truth import TrueFrame
from dynhair.strands import MeshDistance

LARGE_NETWORKS = (*VGG_FIGURES, *FID_FIGURES)
"""The figures by networks that take longer than all else."""


@dataclass(frozen=True)
class Truth:
    """All that a capture says of one frame.

    Attributes:
        frame: its images.
        cameras: that took them.
        head: face, edge of the hair, torso.
        look: as LPIPS sees it.
        appearance: as the other networks and FLIP see it.
        obstacle: head and body in the head's frame; None where they are not known.
    """

    frame: TrueFrame
    cameras: list[Camera]
    head: HeadTruth
    look: TrueLook
    appearance: TrueAppearance
    obstacle: MeshDistance | None


class SegmentTruths:
    """The truth of one segment, taken frame by frame from its first.

    Args:
        capture: what is evaluated against.
        segment: of the capture.
        frames: that will be evaluated.
        rest: the hair that is compared.
        appearance: networks.
        watch: that the time is counted by.
    """

    def __init__(
        self,
        capture: Capture,
        segment: Segment,
        frames: int,
        rest: RestingHair,
        appearance: Appearance,
        watch: Stopwatch,
    ) -> None:
        self.capture, self.segment, self.rest, self.watch = capture, segment, rest, watch
        self.track: HeadTrack = capture.track(segment)
        with watch.part("figures"):
            self.heads, self.motion = HeadTruths(capture, segment), TrueMotion(capture, segment, rest)
        self.still = still_frames(self.track)
        self.looks = TrueLooks(appearance.alexnet, self.still)
        self.appearance = AppearanceTruths(appearance, frames, test=segment.split == "test")
        self._obstacle = HeadObstacle(capture, segment)

    def frame(self, truth: TrueFrame) -> Truth:
        """Work out the next frame that is evaluated."""
        names = self.capture.camera_names
        cameras = [self.capture.camera(self.segment.frames[truth.index], name) for name in names]
        with self.watch.part("figures"):
            head = self.heads.frame(truth, cameras)
            obstacle = None if self.rest.strands is None else self._obstacle.at(truth.index)
        with self.watch.part("networks"):
            look, appearance = self.looks.frame(truth, head.face), self.appearance.frame(truth)
        return Truth(truth, cameras, head, look, appearance, obstacle)


class SegmentMeter:
    """Adds the frames of one head to sums, from the segment's first.

    Args:
        truths: what it is held against.
        sums: of the segment.
        twin: whether it is the rigid twin, which the larger networks do not look at.
    """

    def __init__(self, truths: SegmentTruths, sums: FigureSums, *, twin: bool) -> None:
        self.sums, self.series = sums, Series(truths.segment, truths.capture.fps)
        self._truths, self._twin = truths, twin
        self._images = Meter(sums, self.series, truths.heads, truths.still)
        self._looks = LooksMeter(truths.looks, sums)
        self._appearance = AppearanceMeter(truths.appearance, sums)
        test, fps, motion = truths.segment.split == "test", truths.capture.fps, truths.motion
        self._motion = MotionMeter(fps, truths.rest, motion, motion.stop, sums, self.series, consecutive=test)
        if not test:
            sums.explain(NOT_CONSECUTIVE, *TEMPORAL_FIGURES)

    def add(self, truth: Truth, drawn: Drawn, posed: Any) -> None:
        """Measure the next frame.

        Args:
            truth: of the frame.
            drawn: the images.
            posed: what `DrivenHead.pose` returned.
        """
        watch, index = self._truths.watch, truth.frame.index
        with watch.part("networks"):
            self._looks.add(truth.look, drawn.rgb)
            self._appearance.add(self._looked_at(truth.appearance), drawn.rgb)
        with watch.part("figures"):
            self._images.add(truth.frame, truth.head, drawn)
            if posed.strands is None and index == 0:
                self._motion.choose_points(posed.means, truth.frame.hair, truth.cameras)
            self._motion.add(index, posed_hair(posed, self._truths.track, index), truth.obstacle)

    def finish(self) -> None:
        """Add what is known when all frames have been seen."""
        with self._truths.watch.part("figures"):
            self._motion.finish()
            for name, fid in self._appearance.fids.items():
                self.sums.pool((name,), fid, _distance, fid.samples)
        if self._twin:
            self.sums.explain("it is taken of the avatar alone, not of its rigid twin", *LARGE_NETWORKS)
        if self.sums.held_out is not None:
            self.sums.held_out.explain("it is of no view", *MOTION_FIGURES)
            self.sums.held_out.explain("it is of all views together", *FID_FIGURES)

    def _looked_at(self, truth: TrueAppearance) -> TrueAppearance:
        """What this head is looked at for in a frame."""
        if not self._twin:
            return truth
        return replace(truth, looks={name: look for name, look in truth.looks.items() if name not in LARGE_NETWORKS})


def _distance(fid: FidSums) -> tuple[float]:
    value = fid.value()
    return (math.nan if value is None else value,)


def posed_hair(posed: Any, track: HeadTrack, index: int) -> PosedHair:
    """The hair of a posed head in the head's frame of one frame of a track."""

    def local(points: Tensor) -> Tensor:
        return in_head(points, track, index)

    if posed.strands is None:
        return PosedHair(None, local(posed.means))
    return PosedHair(local(posed.strands))
