"""What the residuals say about cameras and frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from dynhair.preprocess.tracking.reprojection import Reprojection, project
from dynhair.preprocess.tracking.take_track import TakeTrack

_BLOCK_SECONDS = 0.5  # errors of a detector hardly change within; estimates count such blocks as one observation
_ANOTHER_FACE = 0.3  # of the face's side: landmarks farther off are of something else


@dataclass(frozen=True)
class CameraDiagnostics:
    """How one camera disagrees with the others.

    Attributes:
        time_offset: by how many frames its pictures are later than the median camera's.
        time_offset_error: standard error of it; infinite where nothing moved.
        shift: constant error of its landmarks, pixels right and down. Wrong calibration, or a detector that errs in the
            same way all the time.
        shift_error: standard error of it, pixels.
        face_size: median side of the face, pixels; 0 if it never saw the face.
    """

    time_offset: float
    time_offset_error: float
    shift: Float[ndarray, " 2"]
    shift_error: float
    face_size: float


@dataclass(frozen=True)
class TrackingDiagnostics:
    """Residuals and what follows from them.

    Attributes:
        median_residuals: of each take (f, v), the median error in each frame and view, pixels; NaN where nothing was
            seen.
        cameras: how each disagrees with the others.
        lost: of each take, runs of frames whose pose is only bridged.
    """

    median_residuals: tuple[ndarray, ...]
    cameras: tuple[CameraDiagnostics, ...]
    lost: tuple[tuple[range, ...], ...]


def diagnose(
    tracks: Sequence[TakeTrack], data: Sequence[Reprojection], points: Sequence[ndarray]
) -> TrackingDiagnostics:
    """Judge cameras and frames of tracked takes.

    A camera whose clock is off sees every point where it will be a little later: residuals grow with the projected
    velocity, and the slope is the time. The track follows all cameras, so that offsets are counted from the median one.
    Landmarks count by their scores and not by how far they are believed: belief goes to the frames in which a wrong
    camera happens to agree.

    Args:
        tracks: of each take.
        data: landmarks and cameras of each take.
        points: the landmarks on the tracked head, world, (f, n, 3) of each take.
    """
    cameras = max(track.face_sizes.shape[1] for track in tracks)
    blocks = [_blocks(track, part, at) for track, part, at in zip(tracks, data, points, strict=True)]
    per_camera = [np.concatenate([part[view] for part in blocks if view < len(part)]) for view in range(cameras)]
    slopes = [_slope(part[:, 0], part[:, 1]) for part in per_camera]
    known = [slope for slope, error in slopes if np.isfinite(error)]
    reference = float(np.median(known)) if known else 0.0
    diagnosed = []
    for view, (part, (slope, error)) in enumerate(zip(per_camera, slopes, strict=True)):
        seen = part[part[:, 4] > 0, 2:4]
        sizes = np.concatenate([t.face_sizes[:, view] for t in tracks if view < t.face_sizes.shape[1]])
        size = float(np.median(sizes[sizes > 0])) if (sizes > 0).any() else 0.0
        shift = np.median(seen, axis=0) * size if len(seen) else np.zeros(2)
        spread = np.sqrt(((seen * size - shift) ** 2).sum(1).mean() / len(seen)) if len(seen) > 1 else np.inf
        diagnosed.append(
            CameraDiagnostics(slope - reference if np.isfinite(error) else 0.0, error, shift, float(spread), size)
        )
    return TrackingDiagnostics(
        median_residuals=tuple(map(_median_residuals, tracks)),
        cameras=tuple(diagnosed),
        lost=tuple(_runs(track.lost) for track in tracks),
    )


def _blocks(track: TakeTrack, data: Reprojection, points: Float[ndarray, "f n 3"]) -> Float[ndarray, "v b 5"]:
    """Over half-seconds: sums of residual times velocity and of velocity squared; mean residual; sum of weights."""
    ahead, behind = np.concatenate([points[1:], points[-1:]]), np.concatenate([points[:1], points[:-1]])
    velocity = (project(ahead, data.w2c, data.K)[0] - project(behind, data.w2c, data.K)[0]) / 2
    velocity[[0, -1]] = 0
    per_size = np.maximum(track.face_sizes, 1e-9)
    near = np.linalg.norm(track.residuals, axis=-1) < _ANOTHER_FACE * per_size[..., None]
    weights = data.scores * near * (~track.lost)[:, None, None]
    weighted = weights[..., None] * track.residuals
    total = weights.sum(2)
    sums = np.stack(
        [
            (weighted * velocity).sum((2, 3)) / per_size**2,
            (weights[..., None] * velocity**2).sum((2, 3)) / per_size**2,
            *np.moveaxis(weighted.sum(2) / np.where(total > 0, per_size, 1)[..., None], -1, 0),
            total,
        ],
        -1,
    )
    length = max(1, round(_BLOCK_SECONDS * track.fps))
    sums = np.add.reduceat(sums, np.arange(0, len(sums), length), axis=0).swapaxes(0, 1)
    sums[..., 2:4] /= np.maximum(sums[..., 4:], 1e-12)
    return sums


def _slope(products: Float[ndarray, " b"], squares: Float[ndarray, " b"]) -> tuple[float, float]:
    """Regression slope and its standard error, blocks being independent."""
    total, count = squares.sum(), (squares > 0).sum()
    if count < 2:
        return 0.0, np.inf
    slope = products.sum() / total
    error = np.sqrt(((products - slope * squares) ** 2).sum() * count / (count - 1)) / total
    return float(slope), float(error)


def _median_residuals(track: TakeTrack) -> Float[ndarray, "f v"]:
    lengths = np.where(track.belief > 0, np.linalg.norm(track.residuals, axis=-1), np.nan)
    seen = (track.belief > 0).any(2)
    medians = np.full(seen.shape, np.nan)
    medians[seen] = np.nanmedian(lengths[seen], axis=-1)
    return medians


def _runs(flags: ndarray) -> tuple[range, ...]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return tuple(range(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))
