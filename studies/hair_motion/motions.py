"""The study's head motions: eleven to learn from, more of them for longer recordings, and others never learned from."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from dynhair.animation.procedural import PIVOT
from dynhair.errors import DynhairError

FPS = 30.0
FRAMES = 75
"""Of each motion: two and a half seconds."""

ELEVEN = ("turn", "nod", "random1", "tilt", "impulse", "random2", "shake", "lateral", "figure8", "random3", "random4")
"""What networks learn from, in this order when they learn from fewer."""

MORE = tuple(f"random{number}" for number in range(11, 40))
"""What networks learn from beyond the eleven; until then, what designs are compared on."""

UNSEEN = ("stop", "random5", "random6", "random7", "nod-stop", "tilt-stop")
"""Never learned from, and no choice depends on them."""

HALTS = tuple(f"halt{number}" for number in range(1, 13))
"""Random motions that halt, rest, turn back and rest again: what hair does when nothing pulls at it any more."""

LESSONS = (*ELEVEN, *MORE[:20], *HALTS)
"""By which one hairstyle teaches another."""

HALTING_FRAMES = 165

YAW, PITCH, ROLL = 34.0, 15.0, 14.0
"""Degrees that a random motion reaches about each axis, roughly."""


@dataclass(frozen=True)
class HeadMotion:
    """A head's motion in the world: ``x_world = rotation @ x_head + translation``.

    Attributes:
        rotations: head-local to world.
        translations: of the head frame's origin, metres.
        sway: what the shoulders are moved by, metres.
    """

    rotations: Float64[np.ndarray, "f 3 3"]
    translations: Float64[np.ndarray, "f 3"]
    sway: Float64[np.ndarray, "f 3"]


def head_motion(name: str, frames: int | None = None) -> HeadMotion:
    """A motion by name, which begins at rest at the world's origin.

    ``randomN`` is a sum of sines about all axes; above ten, tempo and size are drawn as well. ``haltN`` is one that
    halts.

    Args:
        name: of the motion.
        frames: how many; by default, `HALTING_FRAMES` of a halt and `FRAMES` of another.

    Raises:
        DynhairError: there is no such motion.
    """
    halts = name.startswith("halt")
    times = np.arange(frames or (HALTING_FRAMES if halts else FRAMES)) / FPS
    kind = _halting if halts else _random if name.startswith("random") else _named
    angles, sway = kind(name, times)
    # about y, then x, then z: turning within a nod within a tilt
    rotations = Rotation.from_euler("YXZ", angles, degrees=True).as_matrix()
    return HeadMotion(rotations, PIVOT - rotations @ PIVOT + sway, sway)


def smooth_step(times: Float64[np.ndarray, " f"], start: float, end: float) -> Float64[np.ndarray, " f"]:
    """From 0 at ``start`` to 1 at ``end``, without velocity or acceleration at either."""
    x = np.clip((times - start) / (end - start), 0, 1)
    return x**3 * (10 - 15 * x + 6 * x**2)


def _named(name: str, t: Float64[np.ndarray, " f"]) -> tuple[np.ndarray, np.ndarray]:
    """Yaw, pitch and roll in degrees, and the sway."""
    begun = smooth_step(t, 0.05, 0.35)
    stopped = -32 * smooth_step(t, 0.1, 0.6) + 70 * smooth_step(t, 0.7, 1.1) - 38 * smooth_step(t, 1.7, 2.3)
    still = np.zeros_like(t)

    def swing(degrees: float, hertz: float, phase: float = 0.0) -> np.ndarray:
        return degrees * np.sin(2 * np.pi * hertz * t + phase) * begun

    columns = {
        "turn": (swing(38, 0.75), still, still),
        "nod": (still, swing(24, 0.9), still),
        "tilt": (still, still, swing(26, 0.8)),
        "shake": (swing(22, 1.7), still, still),
        "figure8": (swing(34, 0.6), swing(13, 1.2), still),
        "lateral": (still, still, swing(5, 0.8, 0.5)),
        "impulse": (sum((_jolt(t, k) for k in range(3)), still), still, still),
        "stop": (stopped, still, still),
        "nod-stop": (still, 0.5 * stopped, still),
        "tilt-stop": (0.3 * stopped, still, 0.45 * stopped),
    }
    if name not in columns:
        raise DynhairError(f"no motion is called `{name}`", expected=" or ".join((*ELEVEN, *MORE, *HALTS, *UNSEEN)))
    sway = np.zeros((len(t), 3))
    if name == "lateral":
        sway[:, 0] = swing(0.07, 0.8)
    return np.stack(columns[name], 1), sway


def _jolt(t: Float64[np.ndarray, " f"], number: int) -> np.ndarray:
    """A quick turn and a slower one back, a second for each, to alternate sides."""
    start = 0.2 + number
    there, back = smooth_step(t, start, start + 0.16), smooth_step(t, start + 0.45, start + 0.75)
    return (-1) ** number * 38 * (there - back)


def _halting(name: str, t: Float64[np.ndarray, " f"]) -> tuple[np.ndarray, np.ndarray]:
    """A random motion whose clock halts after a second or two, within a tenth of a second to half of one."""
    number = name.removeprefix("halt")
    if not number.isdecimal():
        raise DynhairError(f"no motion is called `{name}`", expected="`halt` and a number, as halt1")
    generator = np.random.Generator(np.random.PCG64([int(number), zlib.crc32(b"halt")]))
    halt, within = generator.uniform([1.2, 0.1], [2.0, 0.5])
    late = np.clip((t - halt) / within, 0, 1)
    angles, sway = _random(f"random{1000 + int(number)}", np.minimum(t, halt) + within * (late - late**2 / 2))
    return angles * (1 - smooth_step(t, 3.8, 4.4))[:, None], sway


def _random(name: str, t: Float64[np.ndarray, " f"]) -> tuple[np.ndarray, np.ndarray]:
    number = name.removeprefix("random")
    if not number.isdecimal():
        raise DynhairError(f"no motion is called `{name}`", expected="`random` and a number, as random1")
    generator = np.random.Generator(np.random.PCG64([int(number), zlib.crc32(b"head motion")]))
    size, tempo = generator.uniform([0.5, 0.7], [1.3, 1.5]) if int(number) > 10 else (1.0, 1.0)
    begun = smooth_step(t, 0.0, 0.7)
    angles = np.zeros((len(t), 3))
    for column, degrees in enumerate((YAW, PITCH, ROLL)):
        for _ in range(4):
            hertz, phase = tempo * generator.uniform(0.25, 1.3), generator.uniform(0, 2 * np.pi)
            swing = np.sin(2 * np.pi * hertz * t + phase) - np.sin(phase)
            angles[:, column] += size * degrees / 2.6 * swing * begun
    return angles, np.zeros((len(t), 3))
