"""The head of a film: its motion before an assumed camera, its rest pose, and gaps in what was seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from dynhair.animation.video_driver_faces import FaceSeries
from dynhair.preprocess.tracking import Observations
from dynhair.preprocess.tracking.head_motion import HeadMotion

FIELD_OF_VIEW = 53.13
"""Degrees across the longer side of the picture at most: a focal length as long as that side."""

NEAREST = 0.8
"""Metres that a face is away at least: one that looks nearer was filmed through a longer lens."""

REACH = 0.1
"""Metres that the head is never moved beyond from where it rests: further out an avatar has not been seen."""

DEPTH = 0.3
"""Of a move towards the camera that is believed: it shows only in the size of the face, which seems to change as a head
turns, by 2 cm of distance on rendered heads."""

HEAD_CENTRE = np.array([0.0, 0.044, 0.013])
"""Of the open head, between the ears at the height of the eyes, from its head joint, metres."""

_EYES = (33, 263)
_BETWEEN_EYES = 0.088  # metres from outer corner to outer corner on the open head
_ROUNDS = 20
_CALM = 0.5  # rad/s at which a frame counts half
_ASIDE = np.radians(20)  # from the camera at which a frame counts half
_SAME_POSE = np.radians(6)
_HOLD = 0.5  # seconds after which a pose that is held counts less
_SMALLEST = 1e-3  # radians or metres


def assumed_focal(series: FaceSeries, size: tuple[int, int]) -> float:
    """The focal length to track with, in pixels: that of ``FIELD_OF_VIEW``, but no face is nearer than ``NEAREST``.

    A film does not tell. What counts is the distance that follows: with half of the true one, swings of a rendered head
    came out a sixth smaller than with the true one; with one and a half times, a twentieth larger.

    Args:
        series: the face.
        size: width and height of the picture.
    """
    right, left = (series.points[series.seen, point] for point in _EYES)
    across = float(np.median(np.linalg.norm(left - right, axis=1)))
    return max(max(size) / (2 * np.tan(np.radians(FIELD_OF_VIEW) / 2)), NEAREST * across / _BETWEEN_EYES)


def observations(
    series: FaceSeries, size: tuple[int, int], focal: float, hints: Float[np.ndarray, "f e"] | None, name: str
) -> Observations:
    """A film as a take of one camera at the origin of a world with y up, that looks along -z.

    Args:
        series: the face at even times.
        size: width and height of the picture.
        focal: focal length in pixels.
        hints: strengths of the tracking model's expressions, as the detector guesses them.
        name: what messages call the film.
    """
    width, height = size
    K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    w2c = np.c_[np.diag([1.0, -1.0, -1.0]), np.zeros(3)]
    count = len(series.points)
    return Observations(
        points=series.points[:, None, :, :2],
        scores=series.confidence[:, None],
        w2c=np.tile(w2c, (count, 1, 1, 1)),
        K=np.tile(K, (count, 1, 1, 1)),
        expression_hints=hints,
        fps=series.fps,
        name=name,
    )


def seen_from(motion: HeadMotion, origin: Float64[np.ndarray, " 3"]) -> HeadMotion:
    """The same motion of a head whose frame has another origin, which is given in the old frame, metres."""
    return replace(motion, translations=motion.translations + motion.rotations @ origin)


def bridged(motion: HeadMotion, known: Bool[np.ndarray, " f"]) -> HeadMotion:
    """A motion whose unknown frames lie between their neighbours, without overshoot.

    Monotone cubic interpolation, of rotations as rotation vectors about the first known one; before the first and after
    the last known frame, nothing moves.

    Args:
        motion: poses and expressions; anything where not known.
        known: at least one must be.
    """
    if known.all():
        return motion
    (frames,) = np.nonzero(known)
    wanted = np.clip(np.arange(len(known)), frames[0], frames[-1])

    def filled(values: Float[np.ndarray, "f d"]) -> Float[np.ndarray, "f d"]:
        if len(frames) == 1:
            return np.repeat(values[known], len(known), axis=0)
        return np.where(known[:, None], values, PchipInterpolator(frames, values[known])(wanted))

    first = motion.rotations[frames[0]]
    vectors = Rotation.from_matrix(motion.rotations @ first.T).as_rotvec()
    return HeadMotion(
        Rotation.from_rotvec(filled(vectors)).as_matrix() @ first,
        filled(motion.translations),
        filled(motion.expressions),
    )


def rest_pose(
    motion: HeadMotion, known: Bool[np.ndarray, " f"], fps: float
) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]]:
    """Rotation and translation from which a person moves: medians over the frames, of which some count for more.

    Of rotations it is the geodesic median, of translations the geometric one (Weiszfeld's iterations; on SO(3): Hartley
    et al., "L1 rotation averaging", 2011). Calm frames count for more than fast ones. Those that look towards the
    camera count for more than others, for whoever is filmed mostly faces it. The longer a pose is held at a stretch,
    the less each of its frames counts, so that a long look aside weighs less than a pose that is come back to.

    Args:
        motion: of the head, before the camera of `observations`.
        known: frames that were seen; at least one must be.
        fps: frames per second.
    """
    before, after = motion.rotations[:-1], motion.rotations[1:]
    steps = Rotation.from_matrix(after @ before.swapaxes(1, 2)).magnitude() if len(before) else np.zeros(1)
    speed = fps * np.fmax(np.r_[steps[:1], steps], np.r_[steps, steps[-1:]])[: len(known)][known]
    rotations, places = Rotation.from_matrix(motion.rotations[known]), motion.translations[known]
    aside = (rotations * _facing(places).inv()).magnitude()
    weights = _held_shares(rotations, fps) / (1 + speed / _CALM) / (1 + (aside / _ASIDE) ** 2)
    turn, place = rotations.mean(weights), np.average(places, axis=0, weights=weights)
    for _ in range(_ROUNDS):
        turns, shifts = (rotations * turn.inv()).as_rotvec(), places - place
        turn = Rotation.from_rotvec(np.average(turns, axis=0, weights=weights / _lengths(turns))) * turn
        place = place + np.average(shifts, axis=0, weights=weights / _lengths(shifts))
    return turn.as_matrix(), place


def _facing(places: Float64[np.ndarray, "n 3"]) -> Rotation:
    """Rotations of upright heads at some places that look into the camera, which is at the origin."""
    ahead = -places / np.linalg.norm(places, axis=1, keepdims=True)
    left = np.cross([0.0, 1.0, 0.0], ahead)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    return Rotation.from_matrix(np.stack([left, np.cross(ahead, left), ahead], axis=-1))


def _held_shares(rotations: Rotation, fps: float) -> Float64[np.ndarray, " n"]:
    """What each frame of a pose that is held counts: of a hold of t seconds, all together as much as log(1 + t / T)."""
    shares, start = np.ones(len(rotations)), 0
    while start < len(rotations):
        left = (rotations[start:] * rotations[start].inv()).magnitude() > _SAME_POSE
        count = int(left.argmax()) if left.any() else len(left)
        periods = count / fps / _HOLD
        shares[start : start + count] = np.log1p(periods) / periods
        start += count
    return shares


def held_near(motion: HeadMotion, origin: Float64[np.ndarray, " 3"]) -> HeadMotion:
    """The motion with small shifts kept and large ones damped, so that none is longer than ``REACH``.

    Shifts along the line of sight count ``DEPTH``.

    Args:
        motion: of the head, before the camera of `observations`.
        origin: where the head rests, metres.
    """
    shifts = (motion.translations - origin) * [1.0, 1.0, DEPTH]
    lengths = np.maximum(np.linalg.norm(shifts, axis=1, keepdims=True), 1e-9)
    return replace(motion, translations=origin + shifts * np.tanh(lengths / REACH) * REACH / lengths)


def gaps(known: Bool[np.ndarray, " f"]) -> list[range]:
    """Runs of unknown frames."""
    edges = np.flatnonzero(np.diff(np.r_[False, ~known, False].astype(int)))
    return [range(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _lengths(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    return np.maximum(np.linalg.norm(vectors, axis=1), _SMALLEST)
