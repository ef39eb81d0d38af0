"""Cut a small capture out of a large one: fewer motions, frames and views, a coarser mesh, smaller images.

Landmarks in the images are left out: those of a simulated capture are the projections of the mesh's.

The bundled sample was made with the defaults:

    python -m tools.cut_capture straight_long data/sample_capture
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from tools.decimation import decimate
from tyro.conf import Positional

from dynhair.capture import Capture, CaptureWriter, ExpressionBasis, ImageCoding, Manifest, Segment, TrackedMesh, View
from dynhair.capture.arrays import read_npz
from dynhair.errors import DynhairError


def cut_capture(
    source: Positional[Path],
    out: Positional[Path],
    motions: tuple[str, ...] = ("turn", "random1", "stop"),
    frames: int = 44,
    views: tuple[str, ...] = ("00", "02", "03"),
    static_views: int = 12,
    face_model: str = "Anny, four expressions",
    expressions: tuple[str, ...] = ("jaw_open", "smile", "blink", "brow_up"),
    mesh_vertices: int = 1250,
    gt_strands: int = 48,
    gt_points: int = 16,
    jpeg_quality: int = 80,
    mask_levels: int = 8,
    angle_step: int = 8,
    coherence_levels: int = 4,
    min_coverage: float = 0.5,
) -> None:
    """Write a part of a capture as a capture of its own.

    Args:
        source: The capture to cut from.
        out: A folder that does not exist yet.
        motions: Names of the segments to keep, with their splits.
        frames: The first so many frames of each.
        views: Names of the cameras to keep.
        static_views: How many of the static views to keep, evenly spaced.
        face_model: Whose expressions the coefficients are, for a source that does not tell.
        expressions: Names of its first coefficients; the rest have none.
        mesh_vertices: How many vertices of the tracked mesh to keep; the scalp and the landmarks stay as they are.
        gt_strands: How many true strands to keep.
        gt_points: Points to resample them to.
        jpeg_quality: Of the colour images.
        mask_levels: Grey levels of masks and hair masks.
        angle_step: Orientation angles are rounded to this multiple of pi / 256.
        coherence_levels: Levels of the coherence of orientations.
        min_coverage: Orientations are kept where hair covers at least this much of a pixel.
    """
    capture = Capture.open(source)
    kept = [replace(capture.segment(name), count=min(frames, capture.segment(name).count)) for name in motions]
    cut_segments = _renumbered(kept)
    old_ids = [frame for segment in kept for frame in segment.frames]
    if static_views and capture.static_frame not in old_ids:
        raise DynhairError("the frame of the static views is not among those kept", path=source)
    step = max(1, len(capture.static_names) // max(1, static_views))
    static_names = capture.static_names[::step][:static_views]
    notes = dict(capture.manifest.notes or {}) | {"static360": {"views": len(static_names)}, "cut_from": capture.name}
    manifest = Manifest(
        fps=capture.manifest.fps,
        image_size=capture.image_size,
        camera_names=views,
        segments=cut_segments,
        gravity=capture.manifest.gravity,
        background=capture.manifest.background,
        static_frame=old_ids.index(capture.static_frame) if static_names else None,
        expression_basis=capture.expression_basis or _named_basis(capture, face_model, expressions),
        notes=notes,
    )
    coding = ImageCoding("jpg", jpeg_quality, mask_levels, angle_step, coherence_levels)
    with CaptureWriter.create(out, manifest, coding=coding) as writer:
        keep, mesh = _coarse_mesh(capture, kept, mesh_vertices)
        writer.write_mesh(mesh)
        for before, after in zip(kept, cut_segments, strict=True):
            _copy_frames(capture, before, after, keep=keep, min_coverage=min_coverage, writer=writer)
            truth = capture.ground_truth(before)
            if truth is not None:
                strands = _resampled(truth.strands[:, :gt_strands], gt_points)
                writer.write_ground_truth(after, strands.astype(np.float16))
        for name in static_names:
            view = _with_sure_orientation(capture.static_view(name), min_coverage)
            writer.write_static_view(name, capture.static_camera(name), view)


def _named_basis(capture: Capture, face_model: str, expressions: tuple[str, ...]) -> ExpressionBasis:
    count = capture.track(replace(capture.segments[0], count=1)).expressions.shape[1]
    if len(expressions) > count:
        raise DynhairError(
            f"the frames hold {count} expression coefficients",
            path=capture.path,
            expected=f"{len(expressions)} or more, as `--expressions` names",
        )
    return ExpressionBasis(face_model, (*expressions, *[""] * (count - len(expressions))))


def _renumbered(segments: list[Segment]) -> tuple[Segment, ...]:
    starts = np.cumsum([0] + [s.count for s in segments])
    return tuple(replace(s, start=int(start)) for s, start in zip(segments, starts, strict=False))


def _copy_frames(
    capture: Capture,
    before: Segment,
    after: Segment,
    *,
    keep: np.ndarray,
    min_coverage: float,
    writer: CaptureWriter,
) -> None:
    track = capture.track(before)
    names = writer.manifest.camera_names
    for index, (old, new) in enumerate(zip(before.frames, after.frames, strict=True)):
        scale = float(read_npz(capture.layout.params(old), {"scale": (1,)})["scale"][0])
        writer.write_head(new, track.rotations[index], track.translations[index], track.expressions[index], scale=scale)
        writer.write_vertices(new, capture.vertices(old)[keep].astype(np.float16))
        writer.write_landmarks_3d(new, capture.landmarks_3d(old))
        for name, view in zip(names, capture.views([(old, name) for name in names]), strict=True):
            writer.write_view(new, name, capture.camera(old, name), _with_sure_orientation(view, min_coverage))


def _with_sure_orientation(view: View, min_coverage: float) -> View:
    if view.hair is None or view.orientation is None or view.coherence is None:
        return view
    sure = (view.hair >= min_coverage) & (view.coherence > 0)
    return replace(view, orientation=view.orientation * sure, coherence=view.coherence * sure)


def _coarse_mesh(capture: Capture, segments: list[Segment], target: int) -> tuple[np.ndarray, TrackedMesh]:
    """Choose the vertices to keep; return their indices and the mesh between them."""
    mesh = capture.mesh
    if mesh is None:
        raise DynhairError("has no tracked mesh", path=capture.layout.mesh)
    scalp_vertices = np.unique(mesh.faces[mesh.scalp])
    outer = np.flatnonzero(_is_outer(mesh))
    # the expression and the pose of the neck differ between these
    poses = np.stack([capture.vertices(s.frames[i]) for s in segments for i in (0, s.count // 2)])
    keep, faces = decimate(
        poses,
        mesh.faces[outer],
        target,
        locked=np.concatenate([scalp_vertices, mesh.landmarks]),
        weights=0.1 + mesh.follow,
    )
    alive = faces[:, 0] >= 0
    new_index = np.full(len(mesh.follow), -1)
    new_index[keep] = np.arange(len(keep))
    return keep, TrackedMesh(
        faces=new_index[faces[alive]],
        scalp=np.flatnonzero(np.isin(outer, mesh.scalp)[alive]),
        follow=mesh.follow[keep],
        landmarks=new_index[mesh.landmarks],
    )


def _is_outer(mesh: TrackedMesh) -> np.ndarray:
    """Per face, whether its part of the mesh carries landmarks: eyeballs, teeth and tongue do not."""
    edges = np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
    count = len(mesh.follow)
    graph = coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
    _, part = connected_components(graph, directed=False)
    return np.isin(part[mesh.faces[:, 0]], part[mesh.landmarks])


def _resampled(strands: np.ndarray, count: int) -> np.ndarray:
    position = np.linspace(0, strands.shape[2] - 1, count)
    below = np.minimum(position.astype(int), strands.shape[2] - 2)
    fraction = (position - below)[:, None]
    return strands[:, :, below] * (1 - fraction) + strands[:, :, below + 1] * fraction


if __name__ == "__main__":
    tyro.cli(cut_capture)
