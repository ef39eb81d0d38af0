"""Camera paths in files: key frames, between which the camera moves smoothly. docs/animate.md describes them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import PchipInterpolator

from dynhair.errors import DynhairError
from dynhair.storage import read_json

Space = Literal["head", "world"]

DEFAULT_FIELD_OF_VIEW = 30.0
"""Degrees from the image's top to its bottom: a portrait from a metre away."""


class Shots(NamedTuple):
    """Where a camera is at some instants, what it looks at, and how wide.

    Attributes:
        positions: metres.
        targets: metres.
        fields_of_view: degrees from the image's top to its bottom.
    """

    positions: Float64[np.ndarray, "n 3"]
    targets: Float64[np.ndarray, "n 3"]
    fields_of_view: Float64[np.ndarray, " n"]


@dataclass(frozen=True)
class CameraPath:
    """Key frames of a camera.

    Attributes:
        times: seconds, increasing.
        keys: the camera at these times.
        space: whether positions are in the frame of the head at rest, or in the world.
    """

    times: Float64[np.ndarray, " k"]
    keys: Shots
    space: Space

    def at(self, times: Float64[np.ndarray, " n"]) -> Shots:
        """The camera at some instants: monotone cubics between keys, still before the first and after the last."""
        if len(self.times) == 1:
            return Shots(*(np.repeat(values, len(times), axis=0) for values in self.keys))
        inside = np.clip(times, self.times[0], self.times[-1])
        return Shots(*(PchipInterpolator(self.times, values, axis=0)(inside) for values in self.keys))


def read_camera_path(path: Path | str) -> CameraPath:
    """Read a path of key frames.

    Raises:
        DynhairError: the file is missing or damaged, or a key frame is not sound.
    """
    path = Path(path)
    described = read_json(path)
    space = described.get("space", "head")
    if space not in get_args(Space):
        raise DynhairError(f"`space` is {space!r}", path=path, expected=" or ".join(get_args(Space)))
    found = described.get("keyframes")
    if not isinstance(found, list) or not found or not all(isinstance(key, dict) for key in found):
        raise DynhairError("there are no `keyframes`", path=path, expected="a list of objects")
    keys = [_KeyFrame(key, number, path) for number, key in enumerate(found)]
    times = np.array([key.numbers("time", default=0.0 if len(keys) == 1 else None) for key in keys])
    if not (np.diff(times) > 0).all():
        raise DynhairError("`time` does not increase from one key frame to the next", path=path, expected="seconds")
    positions = np.array([key.numbers("position", 3) for key in keys])
    targets = np.array([key.numbers("target", 3, default=np.zeros(3) if space == "head" else None) for key in keys])
    angles = np.array([key.numbers("field_of_view", default=DEFAULT_FIELD_OF_VIEW) for key in keys])
    if (np.linalg.norm(positions - targets, axis=1) < 1e-6).any():
        raise DynhairError("a camera is where it looks at", path=path, expected="`position` apart from `target`")
    if not ((angles > 0) & (angles < 180)).all():
        raise DynhairError("a `field_of_view` is out of range", path=path, expected="degrees above 0 and below 180")
    return CameraPath(times, Shots(positions, targets, angles), space)


class _KeyFrame(NamedTuple):
    values: dict[str, Any]
    number: int
    path: Path

    def numbers(self, name: str, *shape: int, default: Any = None) -> np.ndarray:
        """A finite number, or several."""
        found = self.values.get(name, default)
        try:
            numbers = np.array(found, np.float64)
        except (TypeError, ValueError):
            numbers = np.array(np.nan)
        if numbers.shape != shape or not np.isfinite(numbers).all():
            raise DynhairError(
                f"`{name}` of key frame {self.number} is {found!r}",
                path=self.path,
                expected=f"{shape[0]} numbers, metres" if shape else "a number",
            )
        return numbers
