"""Landmarks through time: one camera's, or those of several cameras that look at the same head."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from jaxtyping import UInt8

from dynhair.camera import Camera
from dynhair.preprocess.landmarks.landmarker import FaceLandmarker, FaceLandmarks
from dynhair.preprocess.landmarks.multiview import FaceInSpace, consistent_views
from dynhair.preprocess.landmarks.square import FaceSquare


def track_landmarks(
    images: Iterable[UInt8[np.ndarray, "h w 3"]], landmarker: FaceLandmarker
) -> Iterator[FaceLandmarks | None]:
    """The landmarks of one camera's consecutive images, each looked for first where the face was before.

    Args:
        images: in order.
        landmarker: finds the face.

    Yields:
        The landmarks of each image, None where there is no face to be seen.
    """
    hint: FaceSquare | None = None
    for image in images:
        face = landmarker.detect(image, hint)
        yield face
        hint = None if face is None else face.square


class FaceTrack:
    """Follows one face through the consecutive frames of calibrated, synchronised cameras.

    Views check one another: where the face was not found, or not where the others saw it, it is looked for once more
    where they say it is. What still contradicts them is dropped, but not if it is near: the same face seen by a camera
    whose clock or calibration is wrong, for tracking to find out.

    Args:
        landmarker: finds the face in each view.
    """

    def __init__(self, landmarker: FaceLandmarker) -> None:
        self._landmarker = landmarker
        self._hints: list[FaceSquare | None] = []

    def follow(
        self, images: Sequence[UInt8[np.ndarray, "h w 3"]], cameras: Sequence[Camera]
    ) -> list[FaceLandmarks | None]:
        """The landmarks of the next frame in every view; None where the face is not to be seen, or was not found.

        Args:
            images: of the frame, one for each camera.
            cameras: the views, in the same order in every frame.
        """
        hints = self._hints or [None] * len(images)
        faces = [hint and self._landmarker.detect_at(image, hint) for image, hint in zip(images, hints, strict=True)]
        faces = self._checked(faces, images, cameras)
        if sum(face is not None for face in faces) < min(2, len(images)):
            searched = [face or self._landmarker.detect(image) for face, image in zip(faces, images, strict=True)]
            faces = self._checked(searched, images, cameras)
        self._hints = [None if face is None else face.square for face in faces]
        return faces

    def _checked(
        self,
        faces: Sequence[FaceLandmarks | None],
        images: Sequence[UInt8[np.ndarray, "h w 3"]],
        cameras: Sequence[Camera],
    ) -> list[FaceLandmarks | None]:
        """The views that agree, those that come to agree when they look where the others say, and those that are near.

        Where no two agree, near is near to what all saw together.
        """
        believed = consistent_views(faces, cameras)
        kept = [face if good else None for face, good in zip(faces, believed, strict=True)]
        telling = kept if sum(face is not None for face in kept) >= 2 else faces
        agreed = [(face, camera) for face, camera in zip(telling, cameras, strict=True) if face is not None]
        if len(agreed) < 2:
            return kept
        found, views = zip(*agreed, strict=True)
        space = FaceInSpace.triangulate(found, views)
        return [
            face or self._recovered(space, image, camera) or (seen if seen and space.is_near(seen, camera) else None)
            for face, seen, image, camera in zip(kept, faces, images, cameras, strict=True)
        ]

    def _recovered(self, space: FaceInSpace, image: UInt8[np.ndarray, "h w 3"], camera: Camera) -> FaceLandmarks | None:
        square = space.square(camera)
        face = square and self._landmarker.detect_at(image, square)
        return face if face is not None and space.agrees(face, camera) else None
