"""The head's pose, expression and mesh in every frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from dynhair.capture.arrays import read_npy, read_npz
from dynhair.capture.records import Segment
from dynhair.face import FaceModel, face_anchors
from dynhair.pictures import Picture
from dynhair.preprocess.jobs import Job
from dynhair.preprocess.landmarks import BLENDSHAPE_NAMES, FaceLandmarks, load_landmarks
from dynhair.preprocess.options import PreprocessOptions
from dynhair.preprocess.steps.step import Step
from dynhair.preprocess.tracking import Observations, TrackingResult, track_head, tracking_warnings
from dynhair.preprocess.workspace import ViewId, Workspace
from dynhair.storage import atomic_file, read_json, write_json

_AXIS_LENGTH = 0.08  # metres
_AXES = ((255, 84, 84), (92, 214, 92), (90, 140, 255))
_MESH = np.array([120, 200, 255], np.float32)
_POINTS = 478
_SLOWEST_FPS = 15.0
"""Hair swings about once or twice a second, and its acceleration is a second difference."""


class TrackingStep(Step[None]):
    """Writes ``params/``, ``mesh.npz`` and what was doubtful.

    Args:
        workspace: with landmarks.
        options: whether silhouettes count, and the name of the face model.
        model: the face model.
    """

    name, title = "tracking", "Head tracking"

    def __init__(self, workspace: Workspace, options: PreprocessOptions, model: FaceModel) -> None:
        super().__init__(workspace)
        self._options = options
        self._model = model
        self._faces = model.faces.numpy()

    def settings(self) -> Mapping[str, Any]:
        return {"face_model": self._options.face_model, "silhouette": self._options.silhouette}

    def jobs(self) -> Sequence[Job[None]]:
        space, layout = self.workspace, self.workspace.layout
        views = [view for view in space.views if not view.is_static]
        inputs = [path for view in views for path in (space.landmarks_path(view), space.camera_path(view))]
        if self._options.silhouette:
            inputs += [space.image_path(view, "mask") for view in views]
        outputs = [layout.mesh, _diagnostics(space)]
        for frame in (frame for segment in space.manifest.segments for frame in segment.frames):
            outputs += [layout.params(frame), layout.landmarks_3d(frame), layout.vertices(frame)]
        return [Job(None, tuple(inputs), tuple(outputs))]

    def worker(self) -> Callable[[None], None]:
        def work(_: None) -> None:
            segments = self.workspace.manifest.segments
            takes = from_neutral([self._observations(segment) for segment in segments])
            masks = self._mask if self._options.silhouette else None
            self._write(track_head(takes, self._model, face_anchors(self._model), masks=masks, progress=self.advance))

        return work

    def picture(self, view: ViewId) -> Picture | None:
        if view.is_static:
            return None
        image, layout = self.workspace.image(view), self.workspace.layout
        vertices = read_npy(layout.vertices(view.frame), (None, 3))
        return drawn_head(
            image,
            self._projected(view, vertices),
            vertices,
            self._faces,
            self._projected(view, self._axes(view.frame)),
            self.workspace.camera(view).centre.numpy(),
        )

    @property
    def note(self) -> str:
        return "The tracked mesh over the pictures, and the head's axes: x red, y green, z blue, 8 cm."

    def _observations(self, segment: Segment) -> Observations:
        names = self.workspace.manifest.camera_names
        faces = [
            [load_landmarks(self.workspace.landmarks_path(ViewId(frame, name))) for name in names]
            for frame in segment.frames
        ]
        cameras = [[self.workspace.camera(ViewId(frame, name)) for name in names] for frame in segment.frames]
        seen = [[_seen(face) for face in row] for row in faces]
        return Observations(
            points=np.array([[points for points, _ in row] for row in seen], np.float64),
            scores=np.array([[scores for _, scores in row] for row in seen], np.float64),
            w2c=np.array([[camera.w2c.numpy() for camera in row] for row in cameras], np.float64),
            K=np.array([[camera.K.numpy() for camera in row] for row in cameras], np.float64),
            expression_hints=self._hints(faces),
            fps=self.workspace.manifest.fps,
            name=segment.name,
        )

    def _hints(self, faces: Sequence[Sequence[FaceLandmarks | None]]) -> Float[np.ndarray, "f e"] | None:
        """What the network thinks of each facial action, views that see the face more openly counting for more."""
        if not set(self._model.expression_names) & set(BLENDSHAPE_NAMES):
            return None
        column = {name: i for i, name in enumerate(BLENDSHAPE_NAMES)}
        hints = np.zeros((len(faces), len(self._model.expression_names)))
        for row, hint in zip(faces, hints, strict=True):
            found = [face for face in row if face is not None]
            if found:
                weights = [face.confidence.mean() for face in found]
                mean = np.average([face.blendshapes for face in found], axis=0, weights=weights)
                hint[:] = [mean[column[n]] if n in column else 0.0 for n in self._model.expression_names]
        return hints

    def _mask(self, take: int, frame: int, view: int) -> UInt8[np.ndarray, "h w"]:
        manifest = self.workspace.manifest
        return self.workspace.mask(ViewId(manifest.segments[take].frames[frame], manifest.camera_names[view]))

    def _write(self, result: TrackingResult) -> None:
        layout, segments = self.workspace.layout, self.workspace.manifest.segments
        for index, (segment, take) in enumerate(zip(segments, result.takes, strict=True)):
            rotations = Rotation.from_matrix(take.motion.rotations).as_rotvec()
            for i, frame in enumerate(segment.frames):
                _save(
                    layout.params(frame),
                    id_coeff=result.person.identity[None].astype(np.float32),
                    exp_coeff=take.motion.expressions[i][None].astype(np.float32),
                    scale=np.array([result.person.scale], np.float32),
                    pose=np.concatenate([rotations[i], take.motion.translations[i]])[None],
                )
                _save(layout.landmarks_3d(frame), result.landmarks_3d(index, i))
                _save(layout.vertices(frame), result.vertices(index, i))
        _save(
            layout.mesh,
            faces=self._faces.astype(np.int32),
            scalp=self._model.scalp.numpy().astype(np.int32),
            follow=self._model.head_weight.numpy().astype(np.float32),
            landmarks68=self._model.landmarks68.numpy().astype(np.int32),
        )
        write_json(_diagnostics(self.workspace), self._doubts(result))

    def _doubts(self, result: TrackingResult) -> dict[str, Any]:
        """What the report shows of a track, as JSON."""
        manifest, noise = self.workspace.manifest, result.rotation_noise
        segments, names = manifest.segments, manifest.camera_names
        return {
            "scale": result.person.scale,
            "noise": None if noise is None else {"omega": noise.omega, "alpha": noise.alpha},
            "takes": {
                segment.name: {
                    "lost": [segment.frames[i] for i in np.flatnonzero(take.lost)],
                    "residuals": [[None if np.isnan(x) else round(float(x), 3) for x in row] for row in residuals],
                }
                for segment, take, residuals in zip(
                    segments, result.takes, result.diagnostics.median_residuals, strict=True
                )
            },
            "warnings": self._limits()
            + [
                {
                    "kind": warning.kind,
                    "text": warning.text,
                    "camera": None if warning.camera is None else names[warning.camera],
                    "take": None if warning.take is None else segments[warning.take].name,
                    "frames": None
                    if warning.take is None or warning.frames is None
                    else [
                        segments[warning.take].frames[warning.frames[0]],
                        segments[warning.take].frames[warning.frames[-1]],
                    ],
                }
                for warning in tracking_warnings(result, names)
            ],
        }

    def _limits(self) -> list[dict[str, Any]]:
        """What no tracking could tell from this recording."""
        manifest = self.workspace.manifest
        known = []
        if len(manifest.camera_names) == 1:
            known.append(("size", "one camera does not show how large the head is: the face model's size is assumed"))
        if manifest.fps < _SLOWEST_FPS:
            known.append(("frame rate", f"{manifest.fps:.4g} frames a second are too few to tell how hair moves"))
        return [{"kind": kind, "text": text, "camera": None, "take": None, "frames": None} for kind, text in known]

    def _axes(self, frame: int) -> Float[np.ndarray, "4 3"]:
        pose = read_npz(self.workspace.layout.params(frame), {"pose": (1, 6)})["pose"][0]
        ends = _AXIS_LENGTH * Rotation.from_rotvec(pose[:3]).as_matrix().T
        return pose[3:] + np.concatenate([np.zeros((1, 3)), ends])

    def _projected(self, view: ViewId, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        return self.workspace.camera(view).project(torch.from_numpy(points.astype(np.float32)))[0].numpy()


def from_neutral(takes: Sequence[Observations]) -> list[Observations]:
    """Count the network's guesses of facial actions from the person's own neutral face.

    A network that knows no person takes brows that are high by nature for raised ones. What it says in half of all
    frames or more is shape; only what goes beyond is expression.

    Args:
        takes: of one person.
    """
    hints = [take.expression_hints for take in takes if take.expression_hints is not None]
    if not hints:
        return list(takes)
    neutral = np.median(np.concatenate(hints), axis=0)
    return [
        take
        if take.expression_hints is None
        else replace(take, expression_hints=np.maximum(take.expression_hints - neutral, 0.0))
        for take in takes
    ]


def read_diagnostics(workspace: Workspace) -> dict[str, Any]:
    """What tracking found doubtful: ``warnings``, ``noise``, and for each of ``takes`` residuals and lost frames."""
    return read_json(_diagnostics(workspace))


def drawn_head(
    image: Picture,
    pixels: Float[np.ndarray, "v 2"],
    vertices: Float[np.ndarray, "v 3"],
    faces: np.ndarray,
    axes: Float[np.ndarray, "4 2"],
    eye: Float[np.ndarray, " 3"],
) -> Picture:
    """Lay a shaded mesh half transparently over a picture, far triangles first, and the head's axes over all.

    Args:
        image: the picture.
        pixels: where the mesh's vertices are in it.
        vertices: where they are in the world.
        faces: triangles, counter-clockwise seen from outside.
        axes: the head's origin and the ends of its x, y and z axes in the picture.
        eye: the camera's position in the world.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = eye - corners.mean(1)
    cosine = (normals * towards).sum(1) / np.maximum(
        np.linalg.norm(normals, axis=1) * np.linalg.norm(towards, axis=1), 1e-12
    )
    layer = image.copy()
    polygons = np.round(pixels[faces] * 16 - 8).astype(np.int32)  # OpenCV's fixed point; centres at whole numbers
    for index in np.argsort(-np.linalg.norm(towards, axis=1)):
        if cosine[index] > 0:
            colour = (_MESH * (0.25 + 0.75 * cosine[index])).tolist()
            cv2.fillConvexPoly(layer, polygons[index], colour, cv2.LINE_8, 4)
    result = cv2.addWeighted(image, 0.45, layer, 0.55, 0).astype(np.uint8)
    origin, *ends = np.round(axes).astype(int).tolist()
    for end, colour in zip(ends, _AXES, strict=True):
        cv2.line(result, origin, end, colour, max(1, image.shape[0] // 200), cv2.LINE_AA)
    return result


def _seen(face: FaceLandmarks | None) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    if face is None:
        return np.zeros((_POINTS, 2)), np.zeros(_POINTS)
    return face.points[:, :2], face.confidence


def _diagnostics(workspace: Workspace) -> Path:
    return workspace.folder / "tracking" / "diagnostics.json"


def _save(path: Path, array: np.ndarray | None = None, **arrays: np.ndarray) -> None:
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        np.save(file, array) if array is not None else np.savez(file, allow_pickle=False, **arrays)
