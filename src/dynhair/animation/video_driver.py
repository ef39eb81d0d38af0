"""Driving an avatar by a plain video of anybody, filmed by one camera that is not known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from dynhair.animation.sources import carried
from dynhair.animation.timed_motion import RestPose, TimedMotion
from dynhair.animation.video_driver_expression import expression_hints, neutral_expression
from dynhair.animation.video_driver_faces import FaceSeries, SeenFace, even_series, follow_face, usual_step
from dynhair.animation.video_driver_frames import frame_count, timed_frames
from dynhair.animation.video_driver_pose import (
    HEAD_CENTRE,
    assumed_focal,
    bridged,
    gaps,
    held_near,
    observations,
    rest_pose,
    seen_from,
)
from dynhair.capture import ExpressionBasis, HeadTrack
from dynhair.errors import DynhairError
from dynhair.face import face_anchors, open_head
from dynhair.preprocess.landmarks import FaceLandmarker
from dynhair.preprocess.tracking import TrackingOptions, track_head
from dynhair.preprocess.tracking.head_motion import HeadMotion

if TYPE_CHECKING:
    from dynhair.avatar import Avatar
    from dynhair.avatar.recording import Recording
    from dynhair.face import FaceModel
    from dynhair.progress import StageProgress

_LONG_GAP = 0.5  # seconds
_SPARSEST = 50.0  # times the frames that a video has, that it should have
_LANDMARKS = 60  # that the pose is fitted to: more cost time and say little, for neighbours err together


def track_of_video(
    path: Path | str,
    recording: Recording,
    avatar: Avatar,
    *,
    face_model: FaceModel | None = None,
    landmarker: FaceLandmarker | None = None,
    progress: StageProgress | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> HeadTrack:
    """The motion of the head that a video shows, as an avatar follows it.

    The face's landmarks are found in every frame, a face model is fitted to them with a smooth motion and no lag (see
    `dynhair.preprocess.tracking`), and the motion is moved so that the person's rest pose becomes the avatar's own. The
    head is taken to be of average size, and the camera to be `assumed_focal`. Frames without a face are bridged; before
    the first and after the last face, the head keeps still. The track begins with the video's first frame.

    Args:
        path: of the video: any size, rotation or frame rate that FFmpeg reads, even or not. It should show one person.
        recording: how the avatar's own person was recorded.
        avatar: what is driven; only whose expressions it takes is asked.
        face_model: of which the avatar's expression coefficients are, to fit them to the landmarks; by default the open
            head, whose expressions are carried over by their names where the avatar's have others.
        landmarker: finds the face; by default MediaPipe's, from the cache of assets.
        progress: shows two stages.
        note: told what the user should know: how much of the face was seen, long gaps, what became of expressions.

    Raises:
        DynhairError: the file is no video, nearly all of its frames are missing, or it does not show a face in two of
            them.
    """
    path, model = Path(path), face_model or open_head()
    frames = _faces(path, landmarker, progress, note)
    _require_frames(frames, path)
    series = even_series(frames)
    found = sum(frame.face is not None for frame in frames)
    if series is None:
        raise DynhairError(
            f"a face was found in {found} of {len(frames)} frames",
            path=path,
            expected="a video of a person whose face can be seen",
            mend="choose a part of the video, or crop it, so that the face is larger and lit",
        )
    note(f"{path.name}: the face was found in {found / len(frames):.1%} of {len(frames)} frames")
    motion, seen = _tracked(path.name, series, frames[0].size, model, progress, note)
    known = _noted_gaps(series, seen, note)

    basis, own = avatar.expression_basis, ExpressionBasis(model.name, model.expression_names)
    if basis is None or basis.name != own.name:  # captures of others have their heads' centres for origins
        motion = seen_from(motion, HEAD_CENTRE)
    rest = rest_pose(motion, seen, series.fps)
    motion = held_near(bridged(motion, known), rest[1])
    before = round((series.start - frames[0].time) * series.fps)
    after = round((frames[-1].time - series.end) * series.fps)
    shown = np.pad(np.arange(len(seen)), (before, after), mode="edge")
    expressions = motion.expressions.clip(*model.expression_range).astype(np.float32)
    driver = TimedMotion(
        times=np.arange(len(shown)) / series.fps,
        rotations=motion.rotations[shown],
        translations=motion.translations[shown],
        expressions=expressions[shown],
        rest=RestPose(*rest, neutral_expression(model, expressions)),
        gravity=recording.gravity,
        expression_basis=own,
    )
    return carried(driver, recording, basis, note)


def _faces(
    path: Path, landmarker: FaceLandmarker | None, progress: StageProgress | None, note: Callable[[str], None]
) -> list[SeenFace]:
    """The face in every frame of the video."""
    total, track = frame_count(path), []
    stage = progress.stage("finding the face", total) if progress else None
    for seen in follow_face(timed_frames(path, note), landmarker or FaceLandmarker()):
        track.append(seen)
        if stage:
            stage.update(len(track), total=max(total, len(track)))
    return track


def _require_frames(frames: list[SeenFace], path: Path) -> None:
    """Make sure that a film's times do not jump, for every missing frame takes memory."""
    times = np.array([frame.time for frame in frames])
    span = float(np.ptp(times))
    if len(times) > 1 and span > _SPARSEST * len(times) * usual_step(times):
        raise DynhairError(
            f"{len(times)} frames are shown over {span:.0f} s",
            path=path,
            expected=f"frames about every {usual_step(times):.3f} s, as most of them are",
            mend="choose a part of the video without the gap, or give it even times with ffmpeg",
        )


def _tracked(
    name: str,
    series: FaceSeries,
    size: tuple[int, int],
    model: FaceModel,
    progress: StageProgress | None,
    note: Callable[[str], None],
) -> tuple[HeadMotion, Bool[np.ndarray, " f"]]:
    """The head's motion before the camera, and in which frames it was seen."""
    focal = assumed_focal(series, size)
    angle = np.degrees(2 * np.arctan(max(size) / (2 * focal)))
    note(f"the camera is taken to see {angle:.0f} degrees across, and the head to be of average size")
    stage = progress.stage("following the head", 1) if progress else None
    result = track_head(
        [observations(series, size, focal, expression_hints(model, series.blendshapes), name)],
        model,
        face_anchors(model),
        TrackingOptions(landmark_count=_LANDMARKS),
        progress=lambda done, total: stage.update(done, total=total) if stage else None,
    )
    return result.takes[0].motion, series.seen & ~result.takes[0].lost


def _noted_gaps(
    series: FaceSeries, seen: Bool[np.ndarray, " f"], note: Callable[[str], None]
) -> Bool[np.ndarray, " f"]:
    """Frames that are in no long gap; says where there are any."""
    known = np.ones_like(seen)
    for gap in gaps(seen):
        if len(gap) > _LONG_GAP * series.fps:
            known[gap] = False
            start, end = (series.start + frame / series.fps for frame in (gap.start, gap.stop))
            note(
                f"no face is to be seen from {start:.1f} s to {end:.1f} s: the head moves on slowly to where it is next"
            )
    return known
