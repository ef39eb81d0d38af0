"""A tiny capture for tests: a sphere for a head, an ellipsoid for a body, and strands that lag behind the head.

Everything is consistent: images, maps, landmarks, tracked mesh and ground truth show the same scene, drawn by painter's
algorithm at four times the resolution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import torch
from PIL import Image, ImageDraw
from scipy.spatial.transform import Rotation

from dynhair.camera import Camera
from dynhair.capture import CaptureWriter, ImageCoding, Manifest, Segment, TrackedMesh, View
from dynhair.capture.records import Split

FPS = 10.0
HEAD_ORIGIN = np.array([0.0, 0.7, 0.0])
HEAD_RADIUS = 0.09
STRANDS, POINTS = 160, 12
_AXES = {"turn": (0, 1, 0), "nod": (1, 0, 0), "tilt": (0, 0, 1)}
_LAG = 0.12  # seconds that the tips lag behind the head
_SUPERSAMPLING = 4


def write_synthetic_capture(
    path: Path | str,
    *,
    frames: int = 6,
    views: int = 3,
    size: int = 48,
    motions: Sequence[str] = ("turn:train", "nod:test"),
    with_gt: bool = True,
    static_views: int = 0,
) -> Path:
    """Write a capture and return its path.

    Args:
        path: a folder that does not exist yet.
        frames: per motion, at 10 frames a second; each motion starts at rest.
        views: cameras in front, spread over 100 degrees.
        size: width and height of the images in pixels.
        motions: ``name:split``; ``turn``, ``nod`` and ``tilt`` have an axis of their own, others turn.
        with_gt: write the true strands.
        static_views: views around the head at the first frame; 0 for none.
    """
    path = Path(path)
    pairs = [motion.partition(":")[::2] for motion in motions]
    segments = tuple(
        Segment(name, i * frames, frames, cast(Split, split or "train")) for i, (name, split) in enumerate(pairs)
    )
    cameras = {f"{i:02d}": _look_at(azimuth, size) for i, azimuth in enumerate(np.linspace(-50, 50, views))}
    manifest = Manifest(fps=FPS, image_size=(size, size), camera_names=tuple(cameras), segments=segments)
    scene = _Scene.build()
    with CaptureWriter.create(path, manifest, coding=ImageCoding(image_format="png")) as writer:
        writer.write_mesh(scene.mesh)
        for segment in segments:
            strands = []
            for index, frame in enumerate(segment.frames):
                state = scene.at(segment.name, index / FPS)
                strands.append(state.strands)
                writer.write_head(frame, state.rotation, HEAD_ORIGIN, state.expression)
                writer.write_vertices(frame, state.vertices.astype(np.float32))
                landmarks = state.vertices[scene.mesh.landmarks]
                writer.write_landmarks_3d(frame, np.delete(landmarks, [48, 54], 0).astype(np.float32))
                for name, camera in cameras.items():
                    writer.write_view(frame, name, camera, scene.draw(state, camera))
                    pixels = camera.project(torch.from_numpy(landmarks).float())[0].numpy()
                    writer.write_landmarks_2d(frame, name, np.c_[pixels, np.ones(68, np.float32)])
            if with_gt:
                writer.write_ground_truth(segment, np.array(strands, np.float32))
        rest = scene.at(segments[0].name, 0.0)
        for i in range(static_views):
            camera = _look_at(360 * i / static_views, size)
            writer.write_static_view(f"{i:02d}", camera, scene.draw(rest, camera))
    return path


@dataclass(frozen=True)
class _State:
    rotation: np.ndarray
    expression: np.ndarray
    vertices: np.ndarray
    strands: np.ndarray


@dataclass(frozen=True)
class _Scene:
    mesh: TrackedMesh
    rest: np.ndarray  # vertices at rest, relative to the head's origin
    strands: np.ndarray  # likewise
    colours: np.ndarray  # of faces, then of strands

    @classmethod
    def build(cls) -> _Scene:
        sphere, faces = _icosphere(2)
        head = sphere * HEAD_RADIUS
        body = sphere * [0.17, 0.13, 0.09] + [0, -0.24, 0]
        corners = sphere[faces]
        centres = corners.mean(1)
        scalp = np.flatnonzero((centres[:, 1] > -0.1) & (centres[:, 2] < 0.25))
        generator = np.random.default_rng(0)
        barycentric = generator.dirichlet((1.0, 1.0, 1.0), STRANDS)
        roots = (head[faces[generator.choice(scalp, STRANDS)]] * barycentric[..., None]).sum(1)
        skin, shirt, hair = (np.array(c, float) for c in ((214, 160, 134), (60, 96, 160), (96, 62, 36)))
        return cls(
            mesh=TrackedMesh(
                faces=np.vstack([faces, faces + len(sphere)]),
                scalp=scalp,
                follow=np.repeat(np.array([1, 0], np.float32), len(sphere)),
                landmarks=np.argsort(-sphere[:, 2], kind="stable")[:68],
            ),
            rest=np.vstack([head, body]),
            strands=_hang(roots),
            colours=np.vstack(
                [
                    np.tile(skin, (len(faces), 1)),
                    np.tile(shirt, (len(faces), 1)),
                    hair * generator.uniform(0.6, 1.4, (STRANDS, 1)),
                ]
            ),
        )

    def at(self, motion: str, time: float) -> _State:
        axis = np.array(_AXES.get(motion, (0, 1, 0)), float)

        def rotation(times: np.ndarray) -> Rotation:
            angle = 0.5 * np.sin(np.pi * np.clip(times, 0, None)) ** 2
            return Rotation.from_rotvec(angle[..., None] * axis)

        now = rotation(np.array(time)).as_matrix()
        late = rotation(time - _LAG * np.linspace(0, 1, POINTS) ** 2).as_matrix()
        strands = _outside(np.einsum("lij,nlj->nli", late, self.strands))
        expression = np.array([np.sin(np.pi * time / 2) ** 2, 0, 0, 0], np.float32)
        rest = self.rest.copy()
        chin = (rest[:, 1] < -0.045) & (rest[:, 2] > 0.02) & (self.mesh.follow == 1)
        rest[chin, 1] -= 0.012 * expression[0]
        moved = np.where(self.mesh.follow[:, None] == 1, rest @ now.T, rest)
        return _State(now, expression, moved + HEAD_ORIGIN, strands + HEAD_ORIGIN)

    def draw(self, state: _State, camera: Camera) -> View:
        """Draw faces and strand segments, far to near."""
        corners = state.vertices[self.mesh.faces]
        segments = np.stack([state.strands[:, :-1], state.strands[:, 1:]], 2).reshape(-1, 2, 3)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        light = 0.55 + 0.45 * (normals / np.linalg.norm(normals, axis=1, keepdims=True)) @ [0.3, 0.6, 0.74]
        shades = np.vstack(
            [self.colours[: len(corners)] * light[:, None], np.repeat(self.colours[len(corners) :], POINTS - 1, 0)]
        )
        fills = [tuple(int(c) for c in shade) for shade in shades.clip(0, 255)]

        pixels, depth = _project(camera, np.concatenate([corners.reshape(-1, 3), segments.reshape(-1, 3)]))
        split = 3 * len(corners)
        polygons, lines = pixels[:split].reshape(-1, 3, 2), pixels[split:].reshape(-1, 2, 2)
        # a strand lies on the face below it: drawn a little nearer, it is not hidden by that face's corners
        order = np.argsort(
            -np.concatenate([depth[:split].reshape(-1, 3).mean(1), depth[split:].reshape(-1, 2).mean(1) - 0.012])
        )
        edge = polygons[:, 1:] - polygons[:, :1]
        facing = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0] < 0
        step = lines[:, 1] - lines[:, 0]
        doubled = 2 * np.arctan2(step[:, 1], step[:, 0])

        canvas = (camera.width * _SUPERSAMPLING, camera.height * _SUPERSAMPLING)
        images = [Image.new(mode, canvas) for mode in ("RGB", "L", "L", "F", "F")]
        brushes = [ImageDraw.Draw(image) for image in images]
        width = max(1, round(0.004 * float(camera.K[0, 0]) * _SUPERSAMPLING))
        for i in order:
            if i < len(corners):
                if facing[i]:
                    outline = [tuple(p) for p in polygons[i]]
                    for brush, fill in zip(brushes, (fills[i], 255, 0, 0.0, 0.0), strict=True):
                        brush.polygon(outline, fill=fill)
            else:
                j = i - len(corners)
                ends = [tuple(p) for p in lines[j]]
                for brush, fill in zip(
                    brushes, (fills[i], 255, 255, float(np.cos(doubled[j])), float(np.sin(doubled[j]))), strict=True
                ):
                    brush.line(ends, fill=fill, width=width)
        rgb, mask, hair, cosine, sine = (_shrunk(image) for image in images)
        return View(
            rgb=rgb / 255,
            mask=mask / 255,
            hair=hair / 255,
            orientation=torch.atan2(sine, cosine).div(2 * torch.pi).remainder(1),
            coherence=torch.hypot(sine, cosine) / (hair / 255).clamp(min=1e-3),
        )


def _hang(roots: np.ndarray) -> np.ndarray:
    """Strands that leave the scalp and fall, relative to the head's origin."""
    outwards = roots / np.linalg.norm(roots, axis=1, keepdims=True)
    points = [roots]
    for i in range(1, POINTS):
        direction = outwards * 0.8**i * 0.8 + np.array([0, -1.0, 0]) * min(1.0, i / 3)
        step = direction / np.linalg.norm(direction, axis=1, keepdims=True) * 0.018
        points.append(_outside(points[-1] + step))
    return np.stack(points, 1)


def _outside(points: np.ndarray) -> np.ndarray:
    """Push points out of the head."""
    distance = np.linalg.norm(points, axis=-1, keepdims=True)
    return points * np.maximum(1.0, HEAD_RADIUS / np.maximum(distance, 1e-9))


def _icosphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    golden = (1 + 5**0.5) / 2
    vertices = np.array(
        [p for a in (-1, 1) for b in (-golden, golden) for p in ((0, a, b), (a, b, 0), (b, 0, a))], float
    )
    vertices /= np.linalg.norm(vertices[0])
    near = np.linalg.norm(vertices[:, None] - vertices, axis=-1) < 1.1
    faces = np.array(
        [
            (i, j, k)
            for i in range(12)
            for j in range(12)
            for k in range(12)
            if i < j
            and i < k
            and near[i, j]
            and near[j, k]
            and near[k, i]
            and np.linalg.det(vertices[[i, j, k]]) > 0
            and j != k
        ]
    )
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=-1)
        unique, middle = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        middle = middle.reshape(-1, 3) + len(vertices)
        a, b, c = faces.T
        ab, bc, ca = middle.T
        faces = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        vertices = np.vstack([vertices, vertices[unique].mean(1)])
        vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    return vertices, faces


def _look_at(azimuth: float, size: int) -> Camera:
    """A camera at 1 m from the subject, turned round it by ``azimuth`` degrees."""
    target = HEAD_ORIGIN - [0, 0.09, 0]
    angle = np.deg2rad(azimuth)
    forward = -np.array([np.sin(angle), 0, np.cos(angle)])
    right = np.cross(forward, [0, 1, 0])
    rotation = np.stack([right, np.cross(forward, right), forward])
    w2c = np.c_[rotation, -rotation @ (target - forward)]
    K = np.array([[1.8 * size, 0, size / 2], [0, 1.8 * size, size / 2], [0, 0, 1]])
    return Camera(torch.from_numpy(w2c).float(), torch.from_numpy(K).float(), size, size)


def _project(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pixels, depth = camera.project(torch.from_numpy(points).float())
    return (pixels * _SUPERSAMPLING - 0.5).numpy(), depth.numpy()


def _shrunk(image: Image.Image) -> torch.Tensor:
    array = np.asarray(image, np.float32)
    blocks = array.reshape(
        array.shape[0] // _SUPERSAMPLING, _SUPERSAMPLING, array.shape[1] // _SUPERSAMPLING, _SUPERSAMPLING, -1
    )
    return torch.from_numpy(blocks.mean((1, 3)).squeeze())
