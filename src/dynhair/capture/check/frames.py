"""Checks of the tracked head: poses, landmarks and mesh of every frame, and how they change from frame to frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from dynhair.capture.arrays import read_npy, read_npz
from dynhair.capture.check.findings import Finding, Severity
from dynhair.capture.layout import Layout
from dynhair.capture.records import Segment, TrackedMesh
from dynhair.errors import DynhairError

Result = TypeVar("Result")

_MAX_TURN_RATE = 30.0  # rad/s; a hard shake of the head stays below 20
_MAX_SPEED = 5.0  # m/s
_FACE_EXTENT = (0.05, 0.4)  # metres; a face's landmarks span about 0.2
_MAX_SCALP_DRIFT = 0.01  # metres, against the head's pose
_MAX_LANDMARK_GAP = 0.01  # metres, median, between landmarks and the mesh's landmark vertices


@dataclass(frozen=True)
class FrameFacts:
    """What was readable of one frame's tracking; None for what was not."""

    pose: np.ndarray | None  # (6,) axis-angle and translation
    expression_count: int | None
    landmarks: np.ndarray | None  # (66, 3)
    vertices: np.ndarray | None  # (V, 3)

    @property
    def head(self) -> np.ndarray | None:
        """Points of the head (N, 3) in the world."""
        if self.landmarks is not None:
            return self.landmarks.astype(np.float64)
        return None if self.pose is None else self.pose[None, 3:]


class TrackingChecker:
    """Reads the tracking of a capture frame by frame and collects what is wrong with it."""

    def __init__(self, layout: Layout, segments: Sequence[Segment], mesh: TrackedMesh | None, fps: float) -> None:
        self.layout = layout
        self.segments = segments
        self.mesh = mesh
        self.fps = fps
        self.findings: list[Finding] = []

    def run(self, advance: Callable[[], None]) -> dict[int, FrameFacts]:
        """Check all frames and return what was read of each; ``advance`` is called after every frame."""
        frames = [frame for segment in self.segments for frame in segment.frames]
        has_vertices = any(self.layout.vertices(frame).exists() for frame in frames)
        facts = {}
        for frame in frames:
            facts[frame] = self._read(frame, has_vertices)
            advance()
        for segment in self.segments:
            self._check_motion(segment, [facts[frame] for frame in segment.frames])
        self._check_expressions(facts)
        self._check_scalp(facts)
        if not has_vertices:
            self._add(
                "warning" if self.mesh is None else "error",
                self.layout.root / "params",
                "no frame has vertices.npy",
                "positions of a tracked mesh, on whose scalp hair is rooted",
                "let the head tracker write its vertices; until then the open head, fitted to the landmarks, stands in",
            )
        elif not self.layout.mesh.exists():
            self._add(
                "warning",
                self.layout.mesh,
                "the file is missing",
                "the topology of vertices.npy, with the scalp marked",
                "write it for the face model that the vertices are of; until then the open head stands in",
            )
        return facts

    def _read(self, frame: int, has_vertices: bool) -> FrameFacts:
        params = self._try(
            lambda: read_npz(self.layout.params(frame), {"pose": (1, 6), "exp_coeff": (1, None)}),
        )
        landmarks = self._try(lambda: self._read_landmarks(frame))
        count = None if self.mesh is None else len(self.mesh.follow)
        vertices = self._try(lambda: read_npy(self.layout.vertices(frame), (count, 3))) if has_vertices else None
        facts = FrameFacts(
            pose=None if params is None else params["pose"][0].astype(np.float64),
            expression_count=None if params is None else params["exp_coeff"].shape[1],
            landmarks=landmarks,
            vertices=vertices,
        )
        self._check_landmarks(frame, facts)
        return facts

    def _try(self, read: Callable[[], Result]) -> Result | None:
        try:
            return read()
        except DynhairError as error:
            self.findings.append(Finding.from_error(error, self.layout.root))
            return None

    def _read_landmarks(self, frame: int) -> np.ndarray:
        landmarks = read_npy(self.layout.landmarks_3d(frame), (66, 3))
        extent = float(np.linalg.norm(np.ptp(landmarks, axis=0)))
        if not _FACE_EXTENT[0] < extent < _FACE_EXTENT[1]:
            raise DynhairError(
                f"landmarks span {extent:.3g} m",
                path=self.layout.landmarks_3d(frame),
                expected="a face of about 0.2 m",
                mend="write everything (cameras, poses, landmarks, vertices) in metres",
            )
        return landmarks

    def _check_landmarks(self, frame: int, facts: FrameFacts) -> None:
        if self.mesh is None or facts.landmarks is None or facts.vertices is None:
            return
        on_mesh = np.delete(facts.vertices[self.mesh.landmarks], [48, 54], 0).astype(np.float64)
        gap = float(np.median(np.linalg.norm(on_mesh - facts.landmarks, axis=1)))
        if gap > _MAX_LANDMARK_GAP:
            self._add(
                "warning",
                self.layout.landmarks_3d(frame),
                f"landmarks are {gap * 100:.1f} cm from the mesh's landmark vertices (median)",
                f"less than {_MAX_LANDMARK_GAP * 100:g} cm",
                "check `landmarks68` in mesh.npz and the order of the landmarks (iBUG-68 without 48 and 54)",
            )

    def _check_motion(self, segment: Segment, facts: Sequence[FrameFacts]) -> None:
        for frame, before, after in zip(segment.frames[1:], facts, facts[1:], strict=False):
            if before.pose is None or after.pose is None:
                continue
            turn = Rotation.from_rotvec(after.pose[:3]) * Rotation.from_rotvec(before.pose[:3]).inv()
            rate = turn.magnitude() * self.fps
            speed = float(np.linalg.norm(after.pose[3:] - before.pose[3:])) * self.fps
            if rate > _MAX_TURN_RATE or speed > _MAX_SPEED:
                self._add(
                    "warning",
                    self.layout.params(frame),
                    f"the head jumps: {rate:.1f} rad/s and {speed:.1f} m/s since the frame before",
                    f"less than {_MAX_TURN_RATE:g} rad/s and {_MAX_SPEED:g} m/s",
                    "end the segment before this frame, or track it again; check `fps`",
                )

    def _check_expressions(self, facts: dict[int, FrameFacts]) -> None:
        counts = {f.expression_count for f in facts.values() if f.expression_count is not None}
        if len(counts) > 1:
            odd = next(frame for frame, f in facts.items() if f.expression_count == min(counts))
            self._add(
                "error",
                self.layout.params(odd),
                f"`exp_coeff` has {min(counts)} coefficients here and {max(counts)} elsewhere",
                "the same number in all frames",
                "track all frames with one face model",
            )

    def _check_scalp(self, facts: dict[int, FrameFacts]) -> None:
        """Seen from the head's pose, the scalp does not move: this finds wrong conventions of the pose."""
        if self.mesh is None or len(self.mesh.scalp) == 0:
            return
        scalp = np.unique(self.mesh.faces[self.mesh.scalp])
        first: np.ndarray | None = None
        for frame, f in facts.items():
            if f.pose is None or f.vertices is None:
                continue
            rotation = Rotation.from_rotvec(f.pose[:3]).as_matrix()
            local = (f.vertices[scalp] - f.pose[3:]) @ rotation
            if first is None:
                first = local
            drift = float(np.sqrt(np.square(local - first).sum(-1).mean()))
            if drift > _MAX_SCALP_DRIFT:
                self._add(
                    "warning",
                    self.layout.vertices(frame),
                    f"the scalp has moved by {drift * 100:.1f} cm against the head's pose",
                    f"less than {_MAX_SCALP_DRIFT * 100:g} cm: x_world = exp(pose[:3]) x_head + pose[3:]",
                    "check the convention of `pose`, and that vertices are of this frame",
                )

    def _add(self, severity: Severity, path: Path, found: str, expected: str, mend: str) -> None:
        self.findings.append(Finding(severity, path.relative_to(self.layout.root), found, expected, mend))


def mesh_faults(mesh: TrackedMesh, file: Path) -> Iterator[Finding]:
    """Yield what is wrong with the tracked mesh's topology."""
    if len(mesh.scalp) == 0:
        yield Finding(
            "error", file, "`scalp` is empty", "indices of the faces that grow hair", "mark the scalp's faces"
        )
    elif len(np.unique(mesh.scalp)) < len(mesh.scalp):
        yield Finding("error", file, "`scalp` names a face twice", "each face once", "write np.unique(scalp)")
    if not ((mesh.follow >= 0) & (mesh.follow <= 1)).all():
        low, high = mesh.follow.min(), mesh.follow.max()
        yield Finding("error", file, f"`follow` is from {low:g} to {high:g}", "0 (body) to 1 (head)")
    flat = (np.sort(mesh.faces, 1)[:, 1:] == np.sort(mesh.faces, 1)[:, :-1]).any(1).sum()
    if flat:
        yield Finding("error", file, f"{flat} faces name a vertex twice", "triangles", "remove these faces")
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    if len(np.unique(edges, axis=0)) < len(edges):
        yield Finding(
            "warning",
            file,
            "faces that share an edge go round in opposite directions",
            "all faces counter-clockwise seen from outside, so that inside and outside are known",
            "turn the faces round consistently",
        )
