"""The networks of MediaPipe's Face Landmarker, and the face mesh that its points belong to."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64

from dynhair.errors import DynhairError
from dynhair.preprocess.landmarks.detector import BOXES, Detector
from dynhair.preprocess.litert import litert_network

CROP_SIZE = 256
POINTS = 478
MESH_POINTS = 468  # the others are the irises'

_FILES = (
    "face_detector.tflite",
    "face_landmarks_detector.tflite",
    "face_blendshapes.tflite",
    "geometry_pipeline_metadata_landmarks.binarypb",
)


@dataclass(frozen=True)
class FaceMesh:
    """MediaPipe's canonical face.

    Attributes:
        vertices: of an average face, centimetres, x to the person's left, y up, z forward.
        faces: triangles, counter-clockwise seen from outside.
    """

    vertices: Float[np.ndarray, "468 3"]
    faces: Int64[np.ndarray, "f 3"]

    @classmethod
    def parse(cls, content: bytes) -> FaceMesh:
        """Read the mesh from MediaPipe's ``GeometryPipelineMetadata``, a protocol buffer.

        Its field 1 is a ``Mesh3d``, of which field 3 holds the vertices, x, y, z, u, v each, and field 4 the triangles.
        """
        mesh = next(value for field, value in _fields(content) if field == 1 and isinstance(value, bytes))
        numbers = [value for field, value in _fields(mesh) if field == 3]
        indices = [value for field, value in _fields(mesh) if field == 4]
        vertices = np.array(numbers, np.float32).reshape(MESH_POINTS, 5)[:, :3]
        return cls(vertices, np.array(indices, np.int64).reshape(-1, 3))


@dataclass(frozen=True)
class FaceNetworks:
    """What one thread needs to find faces; another thread needs another.

    Attributes:
        boxes: finds faces.
        points: an upright face in [0, 1] to points, x and y in pixels of the crop and z in the same unit, smaller
            nearer to the camera, and the logit of whether there is a face.
        blendshapes: 146 of the points, in any unit, to the strengths of 52 facial actions in [0, 1].
        mesh: the mesh of the first 468 points.
    """

    boxes: Detector
    points: Callable[[Float[np.ndarray, "256 256 3"]], tuple[Float[np.ndarray, "478 3"], float]]
    blendshapes: Callable[[Float[np.ndarray, "146 2"]], Float[np.ndarray, " 52"]]
    mesh: FaceMesh

    @classmethod
    def load(cls, path: Path | None = None) -> FaceNetworks:
        """Open the networks.

        Args:
            path: MediaPipe's ``face_landmarker.task``; by default the one of the cache, fetched if it is missing.

        Raises:
            DynhairError: the file cannot be had, or is another one.
        """
        if path is None:
            from dynhair.assets import asset_path

            path = asset_path("face-landmarker")
        try:
            with zipfile.ZipFile(path) as bundle:
                boxes, points, blendshapes, mesh = (bundle.read(name) for name in _FILES)
        except (OSError, zipfile.BadZipFile, KeyError) as error:
            raise DynhairError(
                f"not readable as a face landmarker ({error})",
                path=path,
                expected="MediaPipe's face_landmarker.task, with blendshapes",
                mend="delete the file, and it is fetched again",
            ) from None
        find_boxes, find_points, find_blendshapes = map(litert_network, (boxes, points, blendshapes))

        def detect(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            regressors, logits, *_ = find_boxes(image[None])
            return regressors.reshape(BOXES, 16), logits.reshape(BOXES)

        def locate(crop: np.ndarray) -> tuple[np.ndarray, float]:
            found, logit, *_ = find_points(crop[None])
            return found.reshape(POINTS, 3), logit.item()

        def judge(chosen: np.ndarray) -> np.ndarray:
            return find_blendshapes(chosen[None])[0].reshape(-1)

        return cls(detect, locate, judge, FaceMesh.parse(mesh))


def _fields(message: bytes) -> Iterator[tuple[int, bytes | float | int]]:
    """Numbers and values of a protocol buffer's fields."""
    position = 0

    def varint() -> int:
        nonlocal position
        value = shift = 0
        while True:
            byte = message[position]
            position += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while position < len(message):
        field, kind = divmod(varint(), 8)
        if kind == 0:
            yield field, varint()
        elif kind == 2:
            length = varint()
            yield field, message[position : position + length]
            position += length
        elif kind == 5:
            yield field, struct.unpack_from("<f", message, position)[0]
            position += 4
        else:
            raise ValueError(f"wire type {kind} of field {field}")
