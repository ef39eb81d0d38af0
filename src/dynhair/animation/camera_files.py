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


LEAST_DISTANCE = 1e-6
"""Metres between a camera and what it looks at."""


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
        path: of the file.
    """

    times: Float64[np.ndarray, " k"]
    keys: Shots
    space: Space
    path: Path

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
    for key in keys:
        key.require_known()
    times = np.array([key.numbers("time", default=0.0 if len(keys) == 1 else None) for key in keys])
    (late,) = np.nonzero(np.diff(times) <= 0)
    if len(late):
        found = f"`time` goes from {times[late[0]]:g} s to {times[late[0] + 1]:g} s in key frame {late[0] + 1}"
        raise DynhairError(found, path=path, expected="seconds that increase")
    positions = np.array([key.numbers("position", 3) for key in keys])
    targets = np.array([key.numbers("target", 3, default=np.zeros(3) if space == "head" else None) for key in keys])
    angles = np.array([key.numbers("field_of_view", default=DEFAULT_FIELD_OF_VIEW) for key in keys])
    for number in range(len(keys)):
        if np.linalg.norm(positions[number] - targets[number]) < LEAST_DISTANCE:
            found = f"the camera of key frame {number} is where it looks at"
            raise DynhairError(found, path=path, expected="`position` apart from `target`")
        if not 0 < angles[number] < 180:
            found = f"`field_of_view` of key frame {number} is {angles[number]:g}"
            raise DynhairError(found, path=path, expected="degrees above 0 and below 180")
    return CameraPath(times, Shots(positions, targets, angles), space, path)


_KNOWN = ("time", "position", "target", "field_of_view")


class _KeyFrame(NamedTuple):
    """What a file says of one key frame.

    Attributes:
        values: its JSON object.
        number: its place in the list.
        path: of the file.
    """

    values: dict[str, Any]
    number: int
    path: Path

    def require_known(self) -> None:
        """Make sure that nothing is left unread, such as a name that is misspelt."""
        unknown = [name for name in self.values if name not in _KNOWN]
        if unknown:
            found = f"key frame {self.number} has a `{unknown[0]}`"
            raise DynhairError(found, path=self.path, expected=", ".join(_KNOWN))

    def numbers(self, name: str, *shape: int, default: Any = None) -> np.ndarray:
        """A finite number, or several."""
        found = self.values.get(name, default)
        try:
            numbers = np.array(found)
        except ValueError:  # rows of several lengths
            numbers = np.array("")
        if numbers.dtype.kind not in "fiu" or numbers.shape != shape or not np.isfinite(numbers).all():
            raise DynhairError(
                f"`{name}` of key frame {self.number} is {found!r}",
                path=self.path,
                expected=f"{shape[0]} numbers, metres" if shape else "a number",
            )
        return numbers.astype(np.float64)
