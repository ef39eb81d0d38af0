"""The face's landmarks in every view."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from dynhair.assets import asset_path
from dynhair.pictures import Picture
from dynhair.preprocess.jobs import Job
from dynhair.preprocess.landmarks import (
    FaceLandmarker,
    FaceLandmarks,
    FaceTrack,
    load_landmarks,
    save_landmarks,
    to_ibug68,
)
from dynhair.preprocess.steps.step import Step
from dynhair.preprocess.workspace import STATIC, ViewId
from dynhair.storage import atomic_file

_CHUNK = 24
"""Frames that are done in one go, each looking for the face where it was before."""
_SEEN, _GUESSED = (80, 255, 120), (255, 150, 60)


class LandmarkStep(Step[tuple[int, ...]]):
    """Writes 478 points a view, or that there is no face, to ``preprocess/landmarks``, and iBUG-68 to ``landmarks``."""

    name, title = "landmarks", "Landmarks"

    def settings(self) -> Mapping[str, Any]:
        return {"network": asset_path("face-landmarker").name}

    def jobs(self) -> Sequence[Job[tuple[int, ...]]]:
        chunks = [
            tuple(segment.frames[i : i + _CHUNK])
            for segment in self.workspace.manifest.segments
            for i in range(0, segment.count, _CHUNK)
        ]
        if self.workspace.static_names:
            chunks.append((STATIC,))
        return [self._job(chunk) for chunk in chunks]

    def worker(self) -> Callable[[tuple[int, ...]], None]:
        landmarker = FaceLandmarker()

        def work(frames: tuple[int, ...]) -> None:
            track = FaceTrack(landmarker)
            for frame in frames:
                if self._job((frame,)).is_fresh(self.record):
                    continue
                views = self._views(frame)
                found = track.follow(
                    [self.workspace.image(view) for view in views], [self.workspace.camera(view) for view in views]
                )
                for view, face in zip(views, found, strict=True):
                    if not view.is_static:
                        self._save_ibug68(view, face)
                    save_landmarks(self.workspace.landmarks_path(view), face)

        return work

    def picture(self, view: ViewId) -> Picture:
        image = self.workspace.image(view)
        face = load_landmarks(self.workspace.landmarks_path(view))
        if face is not None:
            radius = max(1, image.shape[0] // 500)
            for (x, y, _), seen in zip(face.points, face.visibility, strict=True):
                colour = _SEEN if seen > 0.5 else _GUESSED
                cv2.circle(image, (round(float(x) - 0.5), round(float(y) - 0.5)), radius, colour, -1, cv2.LINE_AA)
        return image

    @property
    def note(self) -> str:
        views = self.workspace.views
        seen = sum(load_landmarks(self.workspace.landmarks_path(view)) is not None for view in views)
        return f"The face was found in {seen} of {len(views)} views. Orange points are guessed, not seen."

    def _views(self, frame: int) -> tuple[ViewId, ...]:
        names = self.workspace.static_names if frame == STATIC else self.workspace.manifest.camera_names
        return tuple(ViewId(frame, name) for name in names)

    def _job(self, frames: tuple[int, ...]) -> Job[tuple[int, ...]]:
        space = self.workspace
        views = [view for frame in frames for view in self._views(frame)]
        inputs = [path for view in views for path in (space.image_path(view), space.camera_path(view))]
        outputs = [space.landmarks_path(view) for view in views]
        outputs += [space.layout.landmarks_2d(view.frame, view.name) for view in views if not view.is_static]
        return Job(frames, tuple(inputs), tuple(outputs))

    def _save_ibug68(self, view: ViewId, face: FaceLandmarks | None) -> None:
        rows = np.zeros((68, 3), np.float32)
        if face is not None:
            rows[:] = np.c_[to_ibug68(face.points[:, :2]), to_ibug68(face.confidence[:, None])]
        with atomic_file(self.workspace.layout.landmarks_2d(view.frame, view.name)) as path, path.open("wb") as file:
            np.save(file, rows)
