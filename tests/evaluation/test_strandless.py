"""Methods without strands, held-out views, series over time, and what time was spent on."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from stand_ins import CAMERAS, SEGMENTS, StandInAvatar, StandInCapture, StandInPose

from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack
from dynhair.config import Config
from dynhair.evaluation.appearance import Appearance
from dynhair.evaluation.cost import Stopwatch
from dynhair.evaluation.definitions import SILHOUETTE_FIGURES, STRAND_FIGURES
from dynhair.evaluation.held_out import HeldOutViews, held_out_views
from dynhair.evaluation.protocol import evaluate_avatar
from dynhair.evaluation.records import Evaluation
from dynhair.evaluation.series import SERIES, Series, write_series
from dynhair.presets import preset
from dynhair.training.run import Run
from synthetic import write_synthetic_capture


@dataclass(frozen=True)
class Means:
    """A posed head of Gaussians alone."""

    strands: None
    means: torch.Tensor
    posed: StandInPose


@dataclass(frozen=True)
class Colours:
    """Images that do not tell hair from the rest."""

    rgb: torch.Tensor
    hair: None


class Strandless:
    """The stand-in's images, without knowing hair; its Gaussians lie where the strands were."""

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> Means:
        posed = StandInAvatar().pose(track, frame)
        return Means(None, posed.strands.flatten(0, 1), posed)

    def draw(self, posed: Means, cameras: Sequence[Camera]) -> Colours:
        return Colours(StandInAvatar().draw(posed.posed, cameras).rgb, None)


@pytest.fixture(scope="module")
def evaluation(random_networks: Appearance) -> Evaluation:
    held_out = HeldOutViews(("front",))
    return evaluate_avatar(StandInAvatar(), StandInCapture(), held_out=held_out, appearance=random_networks)


def test_a_time_is_counted_once_in_the_innermost_part() -> None:
    watch = Stopwatch()
    with watch.part("outer"):
        time.sleep(0.02)
        with watch.part("inner"):
            time.sleep(0.03)
    cost = watch.cost(5, 4)
    assert cost.parts["inner"] >= 0.03
    assert cost.parts["outer"] >= 0.02
    assert sum(cost.parts.values()) == pytest.approx(cost.seconds)
    assert cost.to_json()["seconds_per_100_frames_and_view"] == pytest.approx(5.0 * cost.seconds)


def test_figures_over_held_out_views_are_of_these_alone(evaluation: Evaluation) -> None:
    capture, errors = StandInCapture(), []
    for segment in SEGMENTS[1:]:
        for index in range(segment.count):
            cameras = [capture.camera(segment.frames[index], name) for name in CAMERAS]
            avatar = StandInAvatar()
            drawn = avatar.draw(avatar.pose(capture.track(segment), index), cameras).rgb.clamp(0.0, 1.0)[1]
            truth = capture.view(segment.frames[index], "front").rgb
            errors.append(-10.0 * np.log10(np.mean((drawn - truth).numpy() ** 2)))
    written = json.loads(json.dumps(evaluation.to_json(), allow_nan=False))["held_out_views"]
    assert written["views"] == ["front"]
    assert written["psnr"] == pytest.approx(np.mean(errors), rel=1e-5)
    assert written["images"] == written["samples"]["psnr"] == len(errors)
    assert written["rigid"]["psnr"] < written["psnr"]
    assert written["cts"] is None
    assert written["reasons"]["cts"] == "it is of no view"


def test_series_hold_what_the_figures_are_means_of(evaluation: Evaluation, tmp_path: Path) -> None:
    write_series(tmp_path / "series.npz", {part.segment.name: part.series for part in evaluation.segments})
    with np.load(tmp_path / "series.npz", allow_pickle=False) as series:
        assert {key.split("/")[1] for key in series} == set(SERIES)
        for part in evaluation.segments[1:]:
            of = {name: series[f"{part.segment.name}/{name}"] for name in SERIES}
            assert all(values.dtype == np.float32 and len(values) == part.segment.count for values in of.values())
            np.testing.assert_allclose(of["time"], np.arange(part.segment.count) / 25.0, rtol=1e-6)
            for name in ("hair_iou", "hair_tiou", "hair_tiou_truth", "tip_error_mm"):
                assert np.nanmean(of[name]) == pytest.approx(part.avatar.values[name], rel=1e-5), name
            # all hair shifts as a whole by 1 cm times (1, 0.5, -0.2) a frame, the avatar's by half of that
            speed = 0.01 * np.linalg.norm([1.0, 0.5, -0.2]) * 25.0
            np.testing.assert_allclose(of["tip_speed_truth"][1:], speed, rtol=1e-4)
            np.testing.assert_allclose(of["tip_speed"][1:], speed / 2, rtol=1e-4)
        assert np.isnan(series["turn/tip_speed"]).all()
        assert np.isfinite(series["turn/hair_iou"]).sum() == 2


def test_a_series_is_nan_until_recorded() -> None:
    series = Series(SEGMENTS[1], 25.0)
    series.record("hair_iou", 2, 0.5)
    assert np.isnan(series.values["hair_iou"]).tolist() == [True, True, False, True]


def test_a_method_without_strands_has_images_and_no_twin(random_networks: Appearance) -> None:
    evaluation = evaluate_avatar(Strandless(), StandInCapture(), appearance=random_networks)
    written = json.loads(json.dumps(evaluation.to_json(), allow_nan=False))
    assert written["rigid"] is None
    assert all(written[name] is None for name in (*STRAND_FIGURES, *SILHOUETTE_FIGURES))
    assert {written["reasons"][name] for name in STRAND_FIGURES} == {"the method has no strands"}
    assert {written["reasons"][name] for name in SILHOUETTE_FIGURES} == {
        "the method does not tell hair from the rest of its images"
    }
    for name in ("psnr", "hair_psnr", "hair_ssim", "hair_lpips", "hair_tiou_truth", "cts_truth", "flip"):
        assert written[name] is not None, name
    assert written["held_out_views"]["views"] == []


def test_which_views_a_run_held_out(tmp_path: Path) -> None:
    capture = Capture.open(write_synthetic_capture(tmp_path / "capture", frames=2, views=3, with_gt=False))
    config: Config = preset("tiny")
    few = replace(config, training=replace(config.training, cameras=1))
    for name, chosen, expected in (("all", config, ()), ("one", few, ("00", "02"))):
        run = Run.create(tmp_path / name, capture.path, chosen)
        assert held_out_views(run, capture).names == expected
    assert held_out_views(Run.open(tmp_path / "all"), capture).reason == "the training used all 3 cameras"
    assert "outside its run" in held_out_views(None, capture).reason
    other = Capture.open(write_synthetic_capture(tmp_path / "other", frames=2, views=1, with_gt=False))
    assert held_out_views(Run.open(tmp_path / "one"), other).reason == "the avatar was trained on another capture"
