"""The protocol on a capture on disk, whose truth is replayed as if an avatar had rendered it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from stand_ins import rigid_twin
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, GroundTruth, HeadTrack, View
from dynhair.evaluation.appearance import VGG_FIGURES
from dynhair.evaluation.definitions import DEFINITIONS, FID_FIGURES, MOTION, STILL_FIGURES, TRUTH_FIGURES
from dynhair.evaluation.protocol import evaluate_avatar
from synthetic import write_synthetic_capture


@dataclass(frozen=True)
class ReplayedPose:
    strands: Tensor
    views: list[View]


@dataclass(frozen=True)
class ReplayedImages:
    rgb: Tensor
    hair: Tensor


class Replay:
    """The truth itself; with rigid hair, the strands of the first frame moved with the head."""

    def __init__(self, capture: Capture) -> None:
        self.capture = capture
        first = capture.track(capture.segments[0])
        self.rest = (self.truth(0).strands[0] - first.translations[0]) @ first.rotations[0]

    def truth(self, segment: int) -> GroundTruth:
        truth = self.capture.ground_truth(self.capture.segments[segment])
        assert truth is not None
        return truth

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> ReplayedPose:
        number = next(i for i, s in enumerate(self.capture.segments) if self.capture.track(s) is track)
        strands = self.truth(number).strands[frame]
        if rigid_hair:
            strands = self.rest @ track.rotations[frame].T + track.translations[frame]
        identity = self.capture.segments[number].frames[frame]
        views = self.capture.views([(identity, name) for name in self.capture.camera_names])
        return ReplayedPose(torch.as_tensor(strands), views)

    def draw(self, posed: ReplayedPose, cameras: Sequence[Camera]) -> ReplayedImages:
        assert len(cameras) == len(posed.views)
        hair = [view.hair for view in posed.views if view.hair is not None]
        return ReplayedImages(torch.stack([view.rgb for view in posed.views]), torch.stack(hair))


def test_the_truth_replayed_is_perfect(tmp_path: Path) -> None:
    capture = Capture.open(write_synthetic_capture(tmp_path / "capture"))
    evaluation = evaluate_avatar(Replay(capture), capture)
    values = evaluation.avatar.values
    assert values["psnr"] == values["hair_psnr"] == 100.0
    assert values["hair_iou"] == 1.0
    assert values["hair_tiou"] == values["hair_tiou_truth"]
    assert values[MOTION] == pytest.approx(1.0, abs=1e-3)
    assert rigid_twin(evaluation).values[MOTION] == pytest.approx(0.0, abs=1e-4)
    assert (evaluation.avatar.frames, evaluation.avatar.images) == (6, 18)


def test_a_capture_without_truth_of_the_strands(tmp_path: Path) -> None:
    capture = Capture.open(write_synthetic_capture(tmp_path / "capture", with_gt=False, views=1))

    class Still(Replay):
        def __init__(self, capture: Capture) -> None:
            self.capture = capture

        def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> ReplayedPose:
            return ReplayedPose(torch.eye(3)[None], self.capture.views([(frame, self.capture.camera_names[0])]))

    figures = evaluate_avatar(Still(capture), capture).avatar
    unknown = {name for name in DEFINITIONS if figures.reasons.get(name) == "the capture holds no true strands"}
    assert unknown == {MOTION, "tip_error_mm", "phase_lag_ms", *TRUTH_FIGURES}
    small = {*VGG_FIGURES, *FID_FIGURES}
    rest = {name for name in DEFINITIONS if figures.values[name] is None} - unknown - small
    assert rest == {"boundary_label_error", "settling_s", "penetration_depth_mm", *STILL_FIGURES}
