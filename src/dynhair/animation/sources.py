"""What drives an avatar: a segment of a capture, a motion by name, a motion file, or a video."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

from dynhair.animation.capture_names import capture_in
from dynhair.animation.expressions import carried_expressions
from dynhair.animation.motion_files import MOTION_SUFFIXES, read_motion
from dynhair.animation.procedural import MOTIONS, motion
from dynhair.animation.resampling import resampled
from dynhair.animation.smoothing import smoothed
from dynhair.animation.timed_motion import RestPose, TimedMotion
from dynhair.capture import Capture, ExpressionBasis, HeadTrack
from dynhair.errors import DynhairError
from dynhair.motion import RestAlignment
from dynhair.preprocess.sources.video import EXTENSIONS as VIDEO_SUFFIXES
from dynhair.training.rest import Rest

if TYPE_CHECKING:
    from dynhair.avatar import Avatar
    from dynhair.avatar.recording import Recording
    from dynhair.evaluation import DrivenHead
    from dynhair.progress import StageProgress


def driving_track(
    spec: str | Path,
    recording: Recording,
    avatar: Avatar | DrivenHead,
    *,
    capture: Path | str | None = None,
    seconds: float | None = None,
    amplitude: float | None = None,
    speed: float = 1.0,
    smoothing: float = 0.0,
    progress: StageProgress | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> HeadTrack:
    """The motion that a specification names, in the avatar's own world and at its own frame rate.

    A driver's motion counts from its rest pose and its neutral expression, and is carried to the avatar's.

    Args:
        spec: a segment of ``capture``; ``CAPTURE:SEGMENT``; one of `MOTIONS`; a motion file; or a video of anybody.
        recording: how the avatar's own person was recorded.
        avatar: what is driven; only whose expressions it takes is asked.
        capture: whose segments a name may mean.
        seconds: of a motion by name; of another, where it is cut off.
        amplitude: of a motion by name, degrees.
        speed: factor of the natural pace of a motion by name.
        smoothing: Hz above which motion counts as jitter, and is removed without lag; 0 leaves it. What is followed in
            a video is smooth already, as far as its landmarks tell.
        progress: shows what takes long.
        note: told what the user should know, a sentence at a time.

    Raises:
        DynhairError: nothing is meant by the specification, or what it means cannot be read or taken.
    """
    spec, basis = str(spec), getattr(avatar, "expression_basis", None)
    found = _segment(spec, capture)
    if found is not None:
        track = carried(segment_motion(*found), recording, basis, note)
    elif spec in MOTIONS:
        track = motion(spec, recording, seconds=seconds, amplitude=amplitude, speed=speed)
        track = replace(track, expression_basis=basis)
    elif Path(spec).suffix.lower() in MOTION_SUFFIXES:
        track = carried(read_motion(spec), recording, basis, note)
    elif Path(spec).suffix.lower() in VIDEO_SUFFIXES:
        from dynhair.animation.video_driver import track_of_video

        expressive = cast("Avatar", avatar)  # only whose expressions it takes is asked
        track = track_of_video(spec, recording, expressive, progress=progress, note=note)
    else:
        raise _unknown(spec, capture)
    if spec not in MOTIONS and seconds is not None:
        track = _cut(track, seconds)
    return smoothed(track, smoothing) if smoothing else track


def names_segment(spec: str | Path) -> bool:
    """Whether a specification can only mean a segment of a capture that it does not name itself."""
    kinds = (*MOTION_SUFFIXES, *VIDEO_SUFFIXES)
    return capture_in(str(spec)) is None and spec not in MOTIONS and Path(spec).suffix.lower() not in kinds


def segment_motion(capture: Capture, name: str) -> TimedMotion:
    """A segment of a capture as a motion, with the rest pose of the capture: what `write_motion` can export.

    Raises:
        DynhairError: there is no such segment, or it cannot be read.
    """
    track, rest = capture.track(capture.segment(name)), Rest.of(capture)
    return TimedMotion.of(track, RestPose(*rest.pose, rest.track.expressions[rest.index]))


def carried(
    motion: TimedMotion, recording: Recording, basis: ExpressionBasis | None, note: Callable[[str], None]
) -> HeadTrack:
    """Carry a driver's motion to an avatar's rest pose, neutral expression, gravity and frame rate.

    Args:
        motion: the driver's.
        recording: how the avatar's own person was recorded.
        basis: whose expression coefficients the avatar takes; None if that is not known.
        note: told what became of the expressions, where they could not be taken over.
    """
    rest = recording.rest
    expressions, said = carried_expressions(motion, rest.expression.numpy(), basis)
    if said is not None:
        note(said)
    neutral = replace(motion.rest, expression=expressions[0])
    track = resampled(replace(motion, expressions=expressions, rest=neutral), recording.fps)
    own = rest.rotation.double().numpy(), rest.translation.double().numpy()
    alignment = RestAlignment.between((motion.rest.rotation, motion.rest.translation), own)
    return replace(alignment.track(track), gravity=recording.gravity, expression_basis=basis)


def _segment(spec: str, capture: Path | str | None) -> tuple[Capture, str] | None:
    """The capture and the name of the segment that a specification means; None if it means something else."""
    named = capture_in(spec)
    if named is not None:
        return Capture.open(named[0], cache_bytes=0), named[1]
    if capture is None:
        return None
    opened = Capture.open(capture, cache_bytes=0)
    return (opened, spec) if spec in [segment.name for segment in opened.segments] else None


def _cut(track: HeadTrack, seconds: float) -> HeadTrack:
    count = max(2, round(seconds * track.fps) + 1)
    return replace(
        track,
        rotations=track.rotations[:count],
        translations=track.translations[:count],
        expressions=track.expressions[:count],
    )


def _unknown(spec: str, capture: Path | str | None) -> DynhairError:
    segments = ""
    if capture is not None:
        names = ", ".join(segment.name for segment in Capture.open(capture, cache_bytes=0).segments)
        segments = f"a segment of {capture} ({names}), "
    kinds = f"a motion file ({' '.join(MOTION_SUFFIXES)}) or a video ({' '.join(VIDEO_SUFFIXES)})"
    return DynhairError(
        f"nothing is known by the motion `{spec}`",
        expected=f"{segments}CAPTURE:SEGMENT, one of {', '.join(MOTIONS)}, {kinds}",
        mend="name the capture of a segment with it, CAPTURE:SEGMENT" if capture is None else None,
    )
