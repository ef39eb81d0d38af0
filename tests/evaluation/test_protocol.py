"""The protocol, against the same measured frame by frame in plain loops with other libraries."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio
from stand_ins import (
    CAMERAS,
    HEIGHT,
    SEGMENTS,
    WIDTH,
    StandInAvatar,
    StandInCapture,
    StandInImages,
    StandInPose,
    image_of,
    rigid_twin,
)

from dynhair.capture import GroundTruth, HeadTrack, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.appearance import APPEARANCE_FIGURES, VGG_FIGURES, Appearance
from dynhair.evaluation.definitions import (
    BOUNDARY_FIGURES,
    DEFINITIONS,
    FACE_FIGURES,
    FID_FIGURES,
    FLICKER,
    HAIR_FIGURES,
    LPIPS_FIGURES,
    MOTION,
    PENETRATION_FIGURES,
    STILL_FIGURES,
    TORSO_FIGURES,
)
from dynhair.evaluation.metrics import ssim
from dynhair.evaluation.perception import Perception
from dynhair.evaluation.protocol import evaluate_avatar, evaluated_indices
from dynhair.evaluation.records import EvaluatedFrame
from dynhair.evaluation.truth import FRAMES_AHEAD

WITHOUT_LANDMARKS_OR_MESH = {*FACE_FIGURES, *TORSO_FIGURES}
UNMEASURED = {
    *WITHOUT_LANDMARKS_OR_MESH,
    *PENETRATION_FIGURES,
    *VGG_FIGURES,
    *FID_FIGURES,
    *STILL_FIGURES,
    *("phase_lag_ms", "settling_s", "settling_s_truth"),
}
"""What neither the stand-in capture nor its networks tell."""

TEST_FRAMES = [(segment, index) for segment in SEGMENTS if segment.split == "test" for index in range(segment.count)]


def rendered(capture: StandInCapture, segment: Segment, index: int, *, rigid: bool) -> StandInImages:
    avatar = StandInAvatar()
    cameras = [capture.camera(segment.frames[index], name) for name in CAMERAS]
    return avatar.draw(avatar.pose(capture.track(segment), index, rigid_hair=rigid), cameras)


def iou(first: np.ndarray, second: np.ndarray) -> float:
    return np.logical_and(first, second).sum() / np.logical_or(first, second).sum()


@pytest.mark.parametrize("rigid", [False, True])
def test_overall_figures_are_means_over_the_images_of_all_test_segments(rigid: bool) -> None:
    capture = StandInCapture()
    evaluation = evaluate_avatar(StandInAvatar(), capture)
    naive: dict[str, list[float]] = {name: [] for name in ({*HAIR_FIGURES, "psnr", "ssim"} - {FLICKER, *STILL_FIGURES})}
    last: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]] = {}
    for segment, index in TEST_FRAMES:
        images = rendered(capture, segment, index, rigid=rigid)
        for view, name in enumerate(CAMERAS):
            truth = capture.view(segment.frames[index], name)
            assert truth.hair is not None
            image, region = images.rgb[view].clamp(0.0, 1.0), truth.hair > 0.5
            mine, true = (images.hair[view] > 0.5).numpy(), region.numpy()
            naive["psnr"].append(peak_signal_noise_ratio(truth.rgb.numpy(), image.numpy(), data_range=1.0))
            inside = truth.rgb[region].numpy(), image[region].numpy()
            naive["hair_psnr"].append(peak_signal_noise_ratio(*inside, data_range=1.0))
            naive["ssim"].append(ssim(image[None], truth.rgb[None]).item())
            naive["hair_ssim"].append(ssim(image[None], truth.rgb[None], region[None]).item())
            naive["hair_iou"].append(iou(mine, true))
            if index:
                before = last[segment.name, view]
                naive["hair_tiou"].append(iou(before[0], mine))
                naive["hair_tiou_truth"].append(iou(before[1], true))
            last[segment.name, view] = mine, true
    figures = rigid_twin(evaluation) if rigid else evaluation.avatar
    for name, values in naive.items():
        assert figures.values[name] == pytest.approx(np.mean(values), rel=1e-5), name
        assert figures.samples[name] == len(values), name
    assert (figures.frames, figures.images) == (7, 14)
    assert set(figures.reasons) == {*UNMEASURED, "boundary_label_error"}


@pytest.mark.parametrize("share", [1.0, 0.5, -0.25])
def test_hair_motion_is_the_share_that_the_avatar_makes(share: float) -> None:
    evaluation = evaluate_avatar(StandInAvatar(share=share), StandInCapture())
    for part in evaluation.segments:
        assert part.avatar.values[MOTION] == pytest.approx(1.0 - abs(1.0 - share), abs=1e-5)
        assert rigid_twin(part).values[MOTION] == pytest.approx(0.0, abs=1e-5)
        assert part.avatar.samples[MOTION] == part.avatar.frames
    assert evaluation.avatar.samples[MOTION] == 7


def test_the_truth_itself_is_perfect() -> None:
    values = evaluate_avatar(StandInAvatar(error=0.0, share=1.0), StandInCapture()).avatar.values
    assert values["psnr"] == values["hair_psnr"] == 100.0
    assert values["ssim"] == pytest.approx(1.0)
    assert values["hair_iou"] == 1.0
    assert values["hair_tiou"] == values["hair_tiou_truth"]


def test_training_segments_are_thinned_and_have_no_temporal_figures() -> None:
    seen: list[EvaluatedFrame] = []
    evaluation = evaluate_avatar(StandInAvatar(), StandInCapture(), observe=seen.append)
    assert [(frame.segment.name, frame.index) for frame in seen] == [
        ("turn", 0),
        ("turn", 5),
        *((segment.name, index) for segment, index in TEST_FRAMES),
    ]
    turn = evaluation.segments[0].avatar
    assert (turn.frames, turn.images) == (2, 4)
    assert turn.values["hair_tiou"] is None
    assert "training segment" in turn.reasons["hair_tiou"]
    assert turn.values["hair_iou"] is not None


def test_observers_see_clamped_images_of_all_views() -> None:
    def check(frame: EvaluatedFrame) -> None:
        assert frame.rigid is not None
        for images in (frame.truth, frame.avatar, frame.rigid):
            assert images.shape == (len(CAMERAS), HEIGHT, WIDTH, 3)
            assert images.min() >= 0.0
            assert images.max() <= 1.0
        identity = frame.segment.frames[frame.index]
        assert torch.equal(frame.truth[1], image_of(identity, "front", (HEIGHT, WIDTH)))
        assert not torch.equal(frame.avatar, frame.rigid)

    evaluate_avatar(StandInAvatar(), StandInCapture(), observe=check)


def test_truth_is_decoded_only_a_few_frames_ahead() -> None:
    capture = StandInCapture(segments=(Segment("long", 3, 30, "test"),))

    def check(frame: EvaluatedFrame) -> None:
        assert len(capture.requested) <= frame.index + 1 + FRAMES_AHEAD

    evaluate_avatar(StandInAvatar(), capture, observe=check)
    assert capture.requested == list(range(3, 33))


def test_without_hair_masks_the_full_image_is_still_measured() -> None:
    figures = evaluate_avatar(StandInAvatar(), StandInCapture(hair=False)).avatar
    needy = {*HAIR_FIGURES, *BOUNDARY_FIGURES, "face_psnr", "face_ssim", *TORSO_FIGURES, "hair_lpips"}
    assert {name for name, value in figures.values.items() if value is None} == {*needy, *UNMEASURED}
    assert {figures.reasons[name] for name in needy} == {"the capture has no hair masks"}


def test_a_capture_without_landmarks_or_mesh_says_so() -> None:
    figures = evaluate_avatar(StandInAvatar(), StandInCapture()).avatar
    assert all(figures.values[name] is None for name in WITHOUT_LANDMARKS_OR_MESH)
    assert {figures.reasons[name] for name in FACE_FIGURES} == {"no 3-D landmarks: the file is missing"}
    assert {figures.reasons[name] for name in TORSO_FIGURES} == {
        "no tracked torso: the capture has no mesh that tells head and body apart"
    }
    assert figures.reasons["boundary_label_error"] == "the avatar does not tell head and body from the background"


def test_without_a_network_its_figures_say_why() -> None:
    nothing = Perception(None, "no connection")
    appearance = Appearance(nothing, nothing, None, "no disk")
    evaluation = evaluate_avatar(StandInAvatar(), StandInCapture(), appearance=appearance)
    names = {*LPIPS_FIGURES, *APPEARANCE_FIGURES} - {"flip"}
    assert all(evaluation.avatar.values[name] is None for name in names)
    assert all(rigid_twin(part).reasons["lpips"] == "no connection" for part in evaluation.segments)
    assert {evaluation.avatar.reasons[name] for name in FID_FIGURES} == {"no disk"}
    assert "rigid twin" in rigid_twin(evaluation).reasons["fid"]
    assert evaluation.protocol["networks"] == "no connection; no connection; no disk"


def test_without_true_strands_hair_motion_is_not_measured() -> None:
    evaluation = evaluate_avatar(StandInAvatar(), StandInCapture(strands=False))
    assert evaluation.avatar.values[MOTION] is None
    assert evaluation.avatar.reasons[MOTION] == "the capture holds no true strands"
    assert evaluation.protocol["true_strands"] == "none"


def test_without_test_segments_only_segments_have_figures() -> None:
    evaluation = evaluate_avatar(StandInAvatar(), StandInCapture(segments=SEGMENTS[:1]))
    written = evaluation.to_json()
    for figures in (written, written["rigid"]):
        assert all(figures[name] is None for name in DEFINITIONS)
        assert set(figures["reasons"].values()) == {"the capture has no test segment"}
        assert figures["segments"]["turn"]["psnr"] is not None


def test_training_segments_can_be_left_out() -> None:
    both, held_out = (
        evaluate_avatar(StandInAvatar(), StandInCapture(), training=training) for training in (True, False)
    )
    assert [part.segment.name for part in both.segments] == ["turn", "stop", "nod"]
    assert [part.segment.name for part in held_out.segments] == ["stop", "nod"]
    assert held_out.avatar == both.avatar
    assert "one in 5 of training segments" in both.protocol["frames"]
    assert "none of training segments" in held_out.protocol["frames"]


def test_training_segments_are_measured_where_there_are_no_others() -> None:
    evaluation = evaluate_avatar(StandInAvatar(), StandInCapture(segments=SEGMENTS[:1]), training=False)
    assert [part.segment.name for part in evaluation.segments] == ["turn"]


def test_json_explains_itself() -> None:
    written = json.loads(json.dumps(evaluate_avatar(StandInAvatar(), StandInCapture()).to_json(), allow_nan=False))
    assert set(written["definitions"]) == set(DEFINITIONS)
    assert [(name, part["split"]) for name, part in written["segments"].items()] == [
        (segment.name, segment.split) for segment in SEGMENTS
    ]
    assert written["rigid"]["segments"]["stop"]["psnr"] < written["segments"]["stop"]["psnr"]
    assert written["protocol"]["views"] == "all 2, 36x32 pixels: side, front"
    assert written["image_size"] == [36, 32]
    assert written["protocol"]["true_strands"].startswith("5 of 4 points")
    assert written["protocol"]["networks"] == "random weights; no VGG16; no Inception"


@pytest.mark.parametrize("of", ["images", "strands"])
def test_an_avatar_that_is_not_finite_is_refused(of: str) -> None:
    class Broken(StandInAvatar):
        def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> StandInPose:
            wrong = float("nan") if track.expressions[frame, 0] == 12 else 0.05
            self.error, self.share = (wrong, 0.5) if of == "images" else (0.05, wrong)
            return super().pose(track, frame, rigid_hair=rigid_hair)

    with pytest.raises(DynhairError, match="not finite in frame 2 of 'stop'"):
        evaluate_avatar(Broken(), StandInCapture())


def test_true_strands_must_be_the_same_in_all_segments() -> None:
    class Inconsistent(StandInCapture):
        def ground_truth(self, segment: Segment) -> GroundTruth | None:
            truth = super().ground_truth(segment)
            return truth if truth is None or segment.name != "nod" else GroundTruth(truth.strands[:, 1:])

    with pytest.raises(DynhairError, match="'nod' has 4 true strands of 4 points"):
        evaluate_avatar(StandInAvatar(), Inconsistent())


def test_evaluated_indices() -> None:
    assert list(evaluated_indices(Segment("a", 100, 12, "train"))) == [0, 5, 10]
    assert list(evaluated_indices(Segment("a", 100, 4, "test"))) == [0, 1, 2, 3]
