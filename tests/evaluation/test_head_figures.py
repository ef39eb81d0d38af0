"""The figures of the head on a capture on disk, against loops over its views with other libraries."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from scipy.ndimage import distance_transform_edt
from scipy.spatial import Delaunay
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack, View
from dynhair.evaluation.appearance import Appearance
from dynhair.evaluation.figures import TORSO_FIGURES
from dynhair.evaluation.perception import PERCEPTION_STRIDE, Perception, enlarged
from dynhair.evaluation.protocol import evaluate_avatar
from dynhair.evaluation.records import Evaluation
from synthetic import write_synthetic_capture

SIZE = 64
FRAMES = PERCEPTION_STRIDE + 2


@dataclass(frozen=True)
class Pose:
    strands: Tensor
    frame: int


@dataclass(frozen=True)
class Images:
    rgb: Tensor
    hair: Tensor
    body: Tensor


class Flawed:
    """The truth with errors that are known; its torso sinks by ``sinking`` pixels after the first frame."""

    def __init__(self, capture: Capture, sinking: float = 0.0) -> None:
        self.capture, self.sinking = capture, sinking

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> Pose:
        segment = next(s for s in self.capture.segments if self.capture.track(s) is track)
        return Pose(torch.eye(3)[None], segment.start + frame)

    def draw(self, posed: Pose, cameras: Sequence[Camera]) -> Images:
        views = views_of(self.capture, posed.frame)
        noise = np.random.default_rng(posed.frame).normal(0.0, 0.02, (len(views), SIZE, SIZE, 3))
        rgb = torch.stack([view.rgb for view in views]) + torch.from_numpy(noise).float()
        if posed.frame not in [segment.start for segment in self.capture.segments]:
            rgb = torch.lerp(rgb, rgb.roll(1, dims=1), self.sinking)
        hair = torch.stack([true_hair(view) for view in views])
        body = torch.stack([view.mask for view in views]) - hair
        return Images(rgb.clamp(0, 1), 0.9 * hair, (0.8 * body).clamp(0, 1))


def views_of(capture: Capture, frame: int) -> list[View]:
    return capture.views([(frame, name) for name in capture.camera_names])


def true_hair(view: View) -> Tensor:
    assert view.hair is not None
    return view.hair


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    path = tmp_path_factory.mktemp("head") / "capture"
    motions = ("nod:train", "turn:test")
    return Capture.open(write_synthetic_capture(path, frames=FRAMES, size=SIZE, motions=motions, with_gt=False))


@pytest.fixture(scope="module")
def evaluation(capture: Capture, random_networks: Appearance) -> Evaluation:
    return evaluate_avatar(Flawed(capture), capture, appearance=random_networks)


def test_face_and_edge_agree_with_loops_over_the_views(capture: Capture, evaluation: Evaluation) -> None:
    naive: dict[str, list[float]] = {
        name: [] for name in ("face_psnr", "face_ssim", "boundary_psnr", "boundary_label_error")
    }
    centres = np.stack(np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5), axis=-1)
    inner = np.zeros((SIZE, SIZE), bool)
    inner[5:-5, 5:-5] = True
    for frame in capture.segment("turn").frames:
        images = Flawed(capture).draw(Pose(torch.zeros(0, 0, 3), frame), [])
        for view, name in enumerate(capture.camera_names):
            truth = capture.view(frame, name)
            true, image, coverage = truth.rgb.numpy(), images.rgb[view].numpy(), true_hair(truth).numpy()
            points = capture.camera(frame, name).project(torch.from_numpy(capture.landmarks_3d(frame)))[0]
            face = (Delaunay(points.double().numpy()).find_simplex(centres) >= 0) & ~(coverage > 0.5)
            if face.any():
                naive["face_psnr"].append(peak_signal_noise_ratio(true[face], image[face], data_range=1.0))
                _, similarity, *_ = structural_similarity(
                    true,
                    image,
                    data_range=1.0,
                    channel_axis=-1,
                    full=True,
                    gaussian_weights=True,
                    sigma=1.5,
                    use_sample_covariance=False,
                )
                naive["face_ssim"].append(float(np.mean(similarity[face & inner])))
            hair = coverage > 0.5
            band = np.asarray(distance_transform_edt(hair)) + np.asarray(distance_transform_edt(~hair)) <= 0.8 + 0.5
            naive["boundary_psnr"].append(peak_signal_noise_ratio(true[band], image[band], data_range=1.0))
            body = (truth.mask.numpy() - coverage).clip(0, None)
            errors = [
                np.abs(images.hair[view].numpy() - coverage)[band],
                np.abs(images.body[view].numpy() - body)[band],
            ]
            naive["boundary_label_error"].append(float(np.mean(errors)))
    for name, values in naive.items():
        assert evaluation.avatar.values[name] == pytest.approx(np.mean(values), rel=1e-4), name
        assert evaluation.avatar.samples[name] == len(values) > 0, name


def test_lpips_is_taken_of_some_frames(capture: Capture, evaluation: Evaluation, random_network: Perception) -> None:
    distance = random_network.distance
    assert distance is not None
    whole, faces = [], []
    first = capture.segment("turn").start
    for frame in (first, first + PERCEPTION_STRIDE):
        images = Flawed(capture).draw(Pose(torch.zeros(0, 0, 3), frame), [])
        for view, name in enumerate(capture.camera_names):
            truth = capture.view(frame, name).rgb
            whole.append(distance(images.rgb[view], truth).item())
            points = capture.camera(frame, name).project(torch.from_numpy(capture.landmarks_3d(frame)))[0].numpy()
            low, high = np.ceil(points.min(axis=0) - 0.5).astype(int), np.floor(points.max(axis=0) + 0.5).astype(int)
            side = max(high - low)
            left, top = (np.round((low + high) / 2 - side / 2)).astype(int)
            crops = [enlarged(image[top : top + side, left : left + side]) for image in (images.rgb[view], truth)]
            faces.append(distance(crops[0], crops[1]).item())
    assert evaluation.avatar.values["lpips"] == pytest.approx(np.mean(whole), rel=1e-4)
    assert evaluation.avatar.samples["lpips"] == evaluation.avatar.samples["face_lpips"] == len(whole)
    assert evaluation.avatar.values["face_lpips"] == pytest.approx(np.mean(faces), rel=0.1)  # crops may be a pixel off
    assert evaluation.protocol["networks"].startswith("random weights")


def test_a_torso_that_sinks_is_told_from_one_that_rests(capture: Capture, evaluation: Evaluation) -> None:
    moving = evaluate_avatar(Flawed(capture, sinking=0.3), capture).avatar
    resting = evaluation.avatar
    assert resting.samples["torso_motion"] == (FRAMES - 1) * len(capture.camera_names)
    floor = [figures.values["torso_motion_truth"] for figures in (moving, resting)]
    assert floor[0] == floor[1]
    assert floor[0] is not None
    assert floor[0] < 0.03
    values = [figures.values["torso_motion"] for figures in (resting, moving)]
    assert values[0] is not None
    assert values[1] is not None
    assert floor[0] < values[0] < 0.1
    assert values[1] > values[0] + 0.1


def test_the_first_frame_alone_has_no_motion(capture: Capture) -> None:
    turn = capture.segment("turn")
    manifest = dataclasses.replace(capture.manifest, segments=(dataclasses.replace(turn, count=1),))
    short = Capture(capture.layout, manifest)
    figures = evaluate_avatar(Flawed(short), short).avatar
    assert all(figures.values[name] is None for name in TORSO_FIGURES)
    assert {figures.reasons[name] for name in TORSO_FIGURES} == {
        "no evaluated image shows edges of the torso in two frames"
    }
