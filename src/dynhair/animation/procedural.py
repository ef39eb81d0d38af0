"""Head motions by name: from rest, without a jolt, about the neck."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from dynhair.avatar.recording import Recording
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError

MotionName = Literal["nod", "turn", "shake", "tilt", "figure-eight", "stop", "impulse"]
MOTIONS: tuple[MotionName, ...] = get_args(MotionName)

PIVOT = np.array([0.0, -0.075, -0.02])
"""Where the neck turns, in the head frame, metres: below and behind the head's origin."""

PITCH, YAW, ROLL = np.eye(3)
"""Axes of the head frame (y up, z out of the face): nodding down, turning to the head's left, tilting."""

STILLNESS = 2.0
"""Seconds without motion that end ``stop`` and ``impulse``: time for the hair to settle."""

WIND_UP, SWEEP = 0.8, 0.4
"""Seconds of the two turns of ``stop`` at natural speed: slowly to one side, fast to the other."""

SWEEP_RISE, SWEEP_STOP = 0.5, 0.2
"""Parts of the fast turn in which it gathers speed, and in which it stops: at natural speed within 0.08 s."""

IMPULSE = 0.18
"""Seconds of either half of ``impulse``, there and back, at natural speed."""


class _Clip(NamedTuple):
    """What a motion is made of: angles in radians, seconds, and the factor of its natural pace."""

    times: Float64[np.ndarray, " f"]
    amplitude: float
    speed: float
    seconds: float


@dataclass(frozen=True)
class _Kind:
    """A named motion.

    Attributes:
        amplitude: degrees.
        seconds: of the clip at natural speed.
        pause: of these, seconds without motion, which do not depend on speed.
        rotation_vectors: the head's turn relative to rest, in the head frame at rest.
    """

    amplitude: float
    seconds: float
    pause: float
    rotation_vectors: Callable[[_Clip], Float64[np.ndarray, "f 3"]]


def motion(
    name: str,
    recording: Recording,
    *,
    seconds: float | None = None,
    amplitude: float | None = None,
    speed: float = 1.0,
) -> HeadTrack:
    """Make a named motion of a head that begins at rest, in the recording's rest pose, with its expression.

    Poses are ``R_t = R_0 exp(r_t)`` and ``T_t = T_0 + R_0 (p - exp(r_t) p)`` with the pivot p, which stays where it is.
    ``nod``, ``turn``, ``shake`` and ``tilt`` oscillate as ``a sin(2 pi f t)`` about their axis, and ``figure-eight`` as
    ``a sin(2 pi f t)`` in yaw and ``a / 2 sin(4 pi f t)`` in pitch; their amplitude grows from nothing within the first
    half period, and ends likewise. ``stop`` turns to one side and fast to the other, where it stops within a moment.
    ``impulse`` is a jolt to one side and back. Angular acceleration is continuous in all of them.

    Args:
        name: one of `MOTIONS`.
        recording: whose rest pose, frame rate and gravity the motion has.
        seconds: of the clip; each motion has its own default.
        amplitude: degrees to either side; each motion has its own default.
        speed: factor of the motion's natural pace.

    Raises:
        DynhairError: there is no such motion, or an option is not positive.
    """
    if name not in _KINDS:
        raise DynhairError(f"no motion is called `{name}`", expected=" or ".join(MOTIONS))
    kind = _KINDS[name]
    amplitude = kind.amplitude if amplitude is None else amplitude
    for option, value in (("amplitude", amplitude), ("speed", speed), ("length", 1.0 if seconds is None else seconds)):
        if not 0 < value < np.inf:
            raise DynhairError(f"a motion's {option} of {value}", expected="a positive number")
    seconds = kind.pause + (kind.seconds - kind.pause) / speed if seconds is None else seconds
    times = np.arange(max(2, round(seconds * recording.fps) + 1)) / recording.fps
    clip = _Clip(times, np.radians(amplitude), speed, seconds)
    return _about_the_neck(kind.rotation_vectors(clip), recording)


def _about_the_neck(vectors: Float64[np.ndarray, "f 3"], recording: Recording) -> HeadTrack:
    rest = recording.rest
    rotation, translation = rest.rotation.double().numpy(), rest.translation.double().numpy()
    turns = Rotation.from_rotvec(vectors).as_matrix()
    return HeadTrack(
        rotations=rotation @ turns,
        translations=translation + (PIVOT - turns @ PIVOT) @ rotation.T,
        expressions=np.tile(rest.expression.numpy(), (len(vectors), 1)),
        fps=recording.fps,
        gravity=recording.gravity,
    )


def _smooth_step(x: Float64[np.ndarray, " f"]) -> Float64[np.ndarray, " f"]:
    """From 0 at 0 to 1 at 1, without velocity or acceleration at either; its steepest slope is 15 / 8."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def _smooth_ramp(x: Float64[np.ndarray, " f"]) -> Float64[np.ndarray, " f"]:
    """The integral of `_smooth_step` from 0."""
    inside = np.clip(x, 0.0, 1.0)
    return inside**4 * (2.5 - 3 * inside + inside**2) + np.maximum(x - 1, 0.0)


def _oscillation(clip: _Clip, frequency: float) -> tuple[Float64[np.ndarray, " f"], Float64[np.ndarray, " f"]]:
    """The phase 2 pi f t, and the amplitude in radians, which begins and ends at 0."""
    frequency *= clip.speed
    fade = min(1 / (2 * frequency), clip.seconds / 2)
    envelope = _smooth_step(clip.times / fade) * _smooth_step((clip.seconds - clip.times) / fade)
    return 2 * np.pi * frequency * clip.times, clip.amplitude * envelope


def _oscillating(frequency: float, axis: np.ndarray) -> Callable[[_Clip], Float64[np.ndarray, "f 3"]]:
    def rotation_vectors(clip: _Clip) -> Float64[np.ndarray, "f 3"]:
        phase, amplitude = _oscillation(clip, frequency)
        return (amplitude * np.sin(phase))[:, None] * axis

    return rotation_vectors


def _figure_eight(clip: _Clip) -> Float64[np.ndarray, "f 3"]:
    phase, amplitude = _oscillation(clip, 0.5)
    return (amplitude * np.sin(phase))[:, None] * YAW + (amplitude / 2 * np.sin(2 * phase))[:, None] * PITCH


def _stop(clip: _Clip) -> Float64[np.ndarray, "f 3"]:
    """To -a by a smooth step; then to +a at a velocity that rises, stays and falls, each smoothly."""
    times = clip.times * clip.speed
    phase = np.maximum(times - WIND_UP, 0.0) / SWEEP
    # phase units of 2 a: the velocity stays v until 1 - SWEEP_STOP, and is v (1 - step) from there on
    velocity = 1 / (1 - SWEEP_RISE / 2 - SWEEP_STOP / 2)
    risen = SWEEP_RISE * _smooth_ramp(phase / SWEEP_RISE)
    fallen = SWEEP_STOP * _smooth_ramp((phase - 1 + SWEEP_STOP) / SWEEP_STOP)
    swept = velocity * (risen - fallen)
    return (clip.amplitude * (2 * swept - _smooth_step(times / WIND_UP)))[:, None] * YAW


def _impulse(clip: _Clip) -> Float64[np.ndarray, "f 3"]:
    times = clip.times * clip.speed / IMPULSE
    return (clip.amplitude * (_smooth_step(times) - _smooth_step(times - 1)))[:, None] * YAW


_KINDS: dict[str, _Kind] = {
    "nod": _Kind(20.0, 4.0, 0.0, _oscillating(0.8, PITCH)),
    "turn": _Kind(38.0, 4.5, 0.0, _oscillating(0.7, YAW)),
    "shake": _Kind(18.0, 3.0, 0.0, _oscillating(1.8, YAW)),
    "tilt": _Kind(20.0, 4.0, 0.0, _oscillating(0.75, ROLL)),
    "figure-eight": _Kind(32.0, 6.0, 0.0, _figure_eight),
    "stop": _Kind(38.0, WIND_UP + SWEEP + STILLNESS, STILLNESS, _stop),
    "impulse": _Kind(30.0, 2 * IMPULSE + STILLNESS, STILLNESS, _impulse),
}
