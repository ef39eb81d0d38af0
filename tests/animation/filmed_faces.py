"""Films of a head whose motion is known, and a landmarker that knows where the landmarks are in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import numpy as np
from av.video.stream import VideoStream
from scipy.spatial.transform import Rotation

from dynhair.face import face_anchors, open_head
from dynhair.preprocess.landmarks import BLENDSHAPE_NAMES, FaceLandmarker, FaceLandmarks, FaceSquare

SIZE = (96, 64)
FOCAL = 160.0
JAW = BLENDSHAPE_NAMES.index("jawOpen")
MARK = 4  # grey levels between the pictures of neighbouring frames


def write_film(
    path: Path, pictures: Sequence[np.ndarray], times: Sequence[float] | None = None, rotation: int = 0
) -> Path:
    """Write pictures without loss, shown at the given seconds, or 25 a second."""
    shown = np.arange(len(pictures)) / 25 if times is None else times
    with av.open(str(path), "w") as container:
        stream = cast(VideoStream, container.add_stream("libx264rgb", rate=25))
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt, stream.options = "rgb24", {"crf": "0", "preset": "ultrafast"}
        stream.codec_context.time_base = Fraction(1, 1000)
        if rotation:
            stream.set_display_rotation(rotation)
        for pixels, time in zip(pictures, shown, strict=True):
            frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
            frame.pts, frame.time_base = round(1000 * time), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def grey(level: int) -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), level, np.uint8)


def write_marked_film(path: Path, times: Sequence[float]) -> Path:
    """Write pictures that say by their grey which frame they are."""
    return write_film(path, [grey(MARK * index) for index in range(len(times))], times)


@dataclass(frozen=True)
class Performance:
    """A head before a camera at the origin that looks along -z: ``x = rotation @ x_head + translation``."""

    times: np.ndarray
    rotations: np.ndarray
    translations: np.ndarray
    jaw: np.ndarray

    @classmethod
    def at(cls, times: np.ndarray) -> Performance:
        """Shaking, nodding a little, and opening the mouth, a metre away."""
        phase = 2 * np.pi * times
        vectors = np.stack([0.15 * np.sin(0.8 * phase), 0.4 * np.sin(0.6 * phase), 0.1 * np.sin(0.5 * phase)], -1)
        return cls(
            times=times,
            rotations=Rotation.from_rotvec(vectors).as_matrix(),
            translations=[0.02, -0.01, -1.0] + 0.03 * np.sin(0.6 * phase)[:, None] * [1.0, 0.3, 0.0],
            jaw=0.4 - 0.4 * np.cos(0.7 * phase),
        )

    def faces(self, noise: float = 0.0) -> list[FaceLandmarks]:
        """What the landmarker finds, with normal errors in pixels; the landmarks drift as its own do."""
        rng = np.random.default_rng(0)
        model = open_head()
        anchors, triangles = face_anchors(model), model.faces.numpy()
        jaw = model.expression_modes[model.expression_names.index("jawOpen")].double().numpy()
        faces = []
        for rotation, translation, opened in zip(self.rotations, self.translations, self.jaw, strict=True):
            places = anchors.positions(model.mean.double().numpy() + opened * jaw, triangles)
            towards = -(places @ rotation.T + translation).mean(0)
            sight = (towards / np.linalg.norm(towards)) @ rotation
            x, y, z = ((places + anchors.displacements(sight)) @ rotation.T + translation).T
            points = np.zeros((478, 3))
            points[anchors.points] = np.stack(
                [SIZE[0] / 2 - FOCAL * x / z, SIZE[1] / 2 + FOCAL * y / z, -FOCAL * z], -1
            )
            points[anchors.points, :2] += noise * rng.normal(size=(len(x), 2))
            missing = np.setdiff1d(np.arange(478), anchors.points)
            points[missing] = points[anchors.points].mean(0)
            blendshapes = np.full(52, 0.2, np.float32)  # this person's neutral face
            blendshapes[JAW] += 0.8 * opened
            faces.append(FaceLandmarks(points.astype(np.float32), np.ones(478, np.float32), 1.0, blendshapes))
        return faces


class KnownFaces(FaceLandmarker):
    """Finds in a marked film the faces that were put there; keeps where it was told to look first."""

    def __init__(self, faces: Sequence[FaceLandmarks | None]) -> None:
        self._faces = faces
        self.hints: list[FaceSquare | None] = []

    def detect(self, image: np.ndarray, hint: FaceSquare | None = None) -> FaceLandmarks | None:
        self.hints.append(hint)
        return self._faces[round(float(image.mean()) / MARK)]
