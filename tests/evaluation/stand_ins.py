"""A capture and an avatar in memory: all that evaluation needs of them, with every value known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, GroundTruth, HeadTrack, Segment, View
from dynhair.capture.layout import Layout
from dynhair.capture.manifest import Manifest
from dynhair.evaluation.figures import Figures
from dynhair.evaluation.records import Evaluation, SegmentFigures

WIDTH, HEIGHT = 36, 32
SEGMENTS = (Segment("turn", 3, 7, "train"), Segment("stop", 10, 4, "test"), Segment("nod", 14, 3, "test"))
CAMERAS = ("side", "front")


class StandInCapture(Capture):
    """Random images and silhouettes; true hair that shifts as a whole in the head's frame."""

    def __init__(
        self,
        segments: tuple[Segment, ...] = SEGMENTS,
        *,
        hair: bool = True,
        strands: bool = True,
        size: tuple[int, int] = (WIDTH, HEIGHT),
    ) -> None:
        super().__init__(Layout(Path("stand-in")), Manifest(25.0, size, CAMERAS, segments))
        self.has_hair, self.has_strands = hair, strands
        self.requested: list[int] = []

    def camera(self, frame: int, name: str) -> Camera:
        """From 2 m: ``front`` looks along the head's -z in the first frame, ``side`` along its -x."""
        track = self.track(self.segments[0])
        away = {"front": [0.0, 0.0, 2.0], "side": [2.0, 0.0, 0.0]}[name]
        centre = torch.from_numpy(track.rotations[0] @ np.array(away) + track.translations[0]).float()
        focal_length = 1.0 + CAMERAS.index(name)  # by which `StandInAvatar` knows the camera
        K = torch.diag(torch.tensor([focal_length, focal_length, 1.0]))
        return Camera(torch.cat([torch.eye(3), -centre[:, None]], 1), K, *self.image_size)

    def views(self, requests: Sequence[tuple[int, str]]) -> list[View]:
        self.requested.append(requests[0][0])
        return [self._view(frame, name) for frame, name in requests]

    def track(self, segment: Segment) -> HeadTrack:
        """The expression is the frame's id, by which `StandInAvatar` knows which frame it is in."""
        angles = np.array([[0.3 * np.sin(frame), 0.1 * frame, 0.2] for frame in segment.frames])
        return HeadTrack(
            rotations=Rotation.from_rotvec(angles).as_matrix(),
            translations=np.array([[0.01 * frame, 1.5, -0.1] for frame in segment.frames]),
            expressions=np.array([[frame] for frame in segment.frames], np.float32),
            fps=self.fps,
            gravity=self.gravity,
        )

    def ground_truth(self, segment: Segment) -> GroundTruth | None:
        if not self.has_strands:
            return None
        track = self.track(segment)
        local = [rest_strands() + true_shift(frame) for frame in segment.frames]
        world = [x @ R.T + T for x, R, T in zip(local, track.rotations, track.translations, strict=True)]
        return GroundTruth(np.array(world, np.float32))

    def _view(self, frame: int, name: str) -> View:
        width, height = self.image_size
        coverage = coverage_of(frame, name, (height, width))
        return View(
            rgb=image_of(frame, name, (height, width)),
            mask=torch.ones(height, width),
            hair=coverage if self.has_hair else None,
            orientation=None,
            coherence=None,
        )


@dataclass(frozen=True)
class StandInPose:
    """What the stand-in avatar needs to render."""

    strands: Tensor
    frame: int
    rigid: bool


@dataclass(frozen=True)
class StandInImages:
    """What the stand-in avatar renders."""

    rgb: Tensor
    hair: Tensor


class StandInAvatar:
    """Renders the truth with an error of its own; its hair shifts by a share of the true shift.

    Args:
        error: standard deviation of the error of its images; twice as much when the hair is held rigid.
        share: of the true hair motion.
    """

    def __init__(self, error: float = 0.05, share: float = 0.5) -> None:
        self.error, self.share = error, share

    @property
    def canonical_strands(self) -> Tensor:
        return torch.from_numpy(rest_strands()).float()

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> StandInPose:
        identity = int(track.expressions[frame, 0])
        local = rest_strands() + (0.0 if rigid_hair else self.share) * true_shift(identity)
        world = local @ track.rotations[frame].T + track.translations[frame]
        return StandInPose(torch.from_numpy(world).float(), identity, rigid_hair)

    def draw(self, posed: StandInPose, cameras: Sequence[Camera]) -> StandInImages:
        size = (cameras[0].height, cameras[0].width)
        images, coverages = [], []
        for camera in cameras:
            name = CAMERAS[int(camera.K[0, 0]) - 1]
            generator = np.random.default_rng([posed.frame, CAMERAS.index(name), posed.rigid])
            noise = generator.normal(0.0, self.error * (1 + posed.rigid), (*size, 3))
            images.append(image_of(posed.frame, name, size) + torch.from_numpy(noise).float())
            coverages.append(coverage_of(posed.frame + (self.error > 0) * 100, name, size))
        return StandInImages(torch.stack(images), torch.stack(coverages))


def rigid_twin(evaluated: Evaluation | SegmentFigures) -> Figures:
    """The figures of the rigid twin, which there is."""
    assert evaluated.rigid is not None
    return evaluated.rigid


def rest_strands() -> np.ndarray:
    """Hair at rest, head frame, metres."""
    return np.random.default_rng(0).normal(0.0, 0.1, (5, 4, 3))


def true_shift(frame: int) -> np.ndarray:
    """How far all hair has shifted from rest, metres; nothing in the capture's first frame."""
    return 0.01 * (frame - SEGMENTS[0].start) * np.array([1.0, 0.5, -0.2])


def image_of(frame: int, name: str, size: tuple[int, int]) -> Tensor:
    """A smooth random image."""
    noise = np.random.default_rng([frame, CAMERAS.index(name)]).normal(0.5, 1.0, (*size, 3))
    return torch.from_numpy(gaussian_filter(noise, (1.5, 1.5, 0.0))).float().clamp(0.0, 1.0)


def coverage_of(frame: int, name: str, size: tuple[int, int]) -> Tensor:
    """A random blob of hair."""
    noise = np.random.default_rng([7, frame, CAMERAS.index(name)]).normal(0.0, 1.0, size)
    return torch.from_numpy(gaussian_filter(noise, 2.0) * 4.0 + 0.6).float().clamp(0.0, 1.0)
