"""One face through a video: found in each frame, then told at even times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

from dynhair.animation.video_driver_frames import TimedFrame
from dynhair.preprocess.landmarks import FaceLandmarker, FaceLandmarks, FaceSquare

_USUAL = 1.5  # times the median step between frames: beyond it a frame was dropped
_WIDEST = 1.75  # steps: landmarks are not interpolated between frames that are further apart
_COINCIDES = 0.05  # of a step
_JUMP, _SPEED = 0.3, 2.0  # of the face's side, and that a second: faces that moved further are others
_SWELL, _GROWTH = 0.22, 0.4  # the same for the logarithm of the side


@dataclass(frozen=True)
class SeenFace:
    """What was found in one frame.

    Attributes:
        time: seconds.
        face: None where there is none to be seen.
        size: width and height of the picture.
    """

    time: float
    face: FaceLandmarks | None
    size: tuple[int, int]


@dataclass(frozen=True)
class FaceSeries:
    """A face at even times, from the first to the last frame in which it was seen.

    Attributes:
        start: time of the first, seconds.
        fps: frames per second.
        points: landmarks, x, y and z in pixels; nought where not seen.
        confidence: how much each counts, in [0, 1]; 0 where not seen.
        blendshapes: strengths of the facial actions ``BLENDSHAPE_NAMES``; interpolated where not seen.
    """

    start: float
    fps: float
    points: Float64[np.ndarray, "f 478 3"]
    confidence: Float64[np.ndarray, "f 478"]
    blendshapes: Float64[np.ndarray, "f 52"]

    @property
    def end(self) -> float:
        """Time of the last, seconds."""
        return self.start + (len(self.points) - 1) / self.fps

    @property
    def seen(self) -> Bool[np.ndarray, " f"]:
        """Whether the face was seen."""
        return self.confidence.max(axis=1) > 0


def follow_face(frames: Iterable[TimedFrame], landmarker: FaceLandmarker) -> Iterator[SeenFace]:
    """Look for the face first where it was last seen, however long ago, and elsewhere only if it is not there.

    What is found at another place or of another size than that face can have by then is not it: hair over a face that
    is turned away makes a detector see small faces anywhere.
    """
    last: tuple[float, FaceSquare] | None = None
    for frame in frames:
        face = landmarker.detect(frame.pixels, None if last is None else last[1])
        if last is not None and face is not None and not _reachable(face.square, last[1], frame.time - last[0]):
            face = landmarker.detect(frame.pixels)
            if face is not None and not _reachable(face.square, last[1], frame.time - last[0]):
                face = None
        if face is not None:
            last = frame.time, face.square
        height, width = frame.pixels.shape[:2]
        yield SeenFace(frame.time, face, (width, height))


def even_series(track: list[SeenFace]) -> FaceSeries | None:
    """The face at even times, at the usual rate of the video; None if it was seen less than twice.

    Between two neighbouring frames, landmarks are interpolated. Where frames are further apart, or without a face, they
    are missing: a tracker knows better how heads move than a straight line does.

    Args:
        track: in the order of time.
    """
    found = [(seen.time, seen.face) for seen in track if seen.face is not None]
    if len(found) < 2:
        return None
    own = np.array([time for time, _ in found])
    faces = [face for _, face in found]
    points = np.array([face.points for face in faces], np.float64)
    confidence = np.array([face.confidence for face in faces], np.float64)
    blendshapes = np.array([face.blendshapes for face in faces], np.float64)

    step = usual_step(np.array([seen.time for seen in track]))
    even = own[0] + step * np.arange(round((own[-1] - own[0]) / step) + 1)
    after = np.clip(np.searchsorted(own, even), 1, len(own) - 1)
    before = after - 1
    gap = own[after] - own[before]
    share = np.clip((even - own[before]) / gap, 0.0, 1.0)
    nearest = np.minimum(np.abs(even - own[before]), np.abs(even - own[after]))
    known = (gap <= _WIDEST * step) | (nearest <= _COINCIDES * step)
    share = np.where(gap <= _WIDEST * step, share, np.round(share))

    def at_even_times(values: Float[np.ndarray, "n *d"], share: Float[np.ndarray, " f"]) -> Float[np.ndarray, "f *d"]:
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return (1 - weight) * values[before] + weight * values[after]

    return FaceSeries(
        start=float(own[0]),
        fps=float(1 / step),
        points=at_even_times(points, share) * known[:, None, None],
        confidence=at_even_times(confidence, share) * known[:, None],
        blendshapes=at_even_times(blendshapes, np.clip((even - own[before]) / gap, 0.0, 1.0)),
    )


def usual_step(times: Float[np.ndarray, " n"]) -> float:
    """Seconds between frames, dropped ones aside."""
    steps = np.diff(times)
    return float(steps[steps <= _USUAL * np.median(steps)].mean())


def _reachable(square: FaceSquare, last: FaceSquare, seconds: float) -> bool:
    """Whether a face can have come from one square to another."""
    moved = float(np.linalg.norm(np.subtract(square.centre, last.centre))) / last.side
    swollen = abs(float(np.log(square.side / last.side)))
    return moved <= _JUMP + _SPEED * seconds and swollen <= _SWELL + _GROWTH * seconds
