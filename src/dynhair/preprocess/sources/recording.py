"""A raw recording: takes, each filmed by several calibrated cameras at once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8

from dynhair.capture.records import Split
from dynhair.preprocess.options import Up


@dataclass(frozen=True, eq=False)
class SourceCamera:
    """A camera as it was calibrated, in the recording's own world.

    Attributes:
        w2c: world-to-camera ``[R | t]``, OpenCV axes, in the world's units.
        K: in pixels of ``size``, pixel centres at (i + 0.5, j + 0.5).
        distortion: OpenCV's coefficients; empty for none.
        fisheye: whether they are those of OpenCV's fisheye model.
        size: width and height that it was calibrated for; None if those of the pictures.
    """

    w2c: Float64[np.ndarray, "3 4"]
    K: Float64[np.ndarray, "3 3"]
    distortion: Float64[np.ndarray, " n"] = field(default_factory=lambda: np.zeros(0))
    fisheye: bool = False
    size: tuple[int, int] | None = None


@dataclass(frozen=True)
class World:
    """Units and axes of a recording's world.

    Attributes:
        metres_per_unit: length of its unit.
        up: its axis that points up.
    """

    metres_per_unit: float = 1.0
    up: Up = "y"

    @property
    def to_y_up(self) -> Float64[np.ndarray, "3 3"]:
        """The rotation that takes the up axis to y; it keeps an axis in place, z where it can."""
        rows = {
            "x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
            "-x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
            "y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
            "-y": [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
            "z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
            "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        }
        return np.array(rows[self.up], np.float64)

    def to_metres(self, w2c: Float64[np.ndarray, "3 4"]) -> Float64[np.ndarray, "3 4"]:
        """Express a world-to-camera matrix in the world in metres with y up."""
        return np.c_[w2c[:, :3] @ self.to_y_up.T, w2c[:, 3] * self.metres_per_unit]


@dataclass(frozen=True)
class Frames(ABC):
    """The pictures of one camera in one take.

    Attributes:
        path: the file or folder, for messages.
    """

    path: Path

    @property
    @abstractmethod
    def count(self) -> int:
        """How many there are."""

    @property
    @abstractmethod
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""

    @property
    @abstractmethod
    def fps(self) -> float | None:
        """Frames per second; None if the source does not say."""

    @abstractmethod
    def read(
        self, indices: Iterable[int], note: Callable[[str], None]
    ) -> Iterator[tuple[int, UInt8[np.ndarray, "h w 3"]]]:
        """Yield the pictures of ascending indices, reading once from front to back.

        Args:
            indices: which, counted from 0.
            note: told what the user should know.
        """


@dataclass(frozen=True)
class Channel:
    """What one camera filmed in one take.

    Attributes:
        frames: the pictures.
        camera: of a picture by its index: the same object for all if the camera stood still.
        masks: ``mask`` or ``hair`` to the file for each picture, None where there is none.
    """

    frames: Frames
    camera: Callable[[int], SourceCamera]
    masks: Mapping[str, tuple[Path | None, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Take:
    """A run of frames without a cut.

    Attributes:
        name: as in the recording.
        channels: camera to what it filmed.
        split: if the recording says it.
    """

    name: str
    channels: Mapping[str, Channel]
    split: Split | None = None


@dataclass(frozen=True)
class StaticRing:
    """Single pictures from all round the head, motionless, as it is in one frame of a take.

    Attributes:
        channels: view to its one picture.
        take: the take's name.
        index: of the frame in it.
    """

    channels: Mapping[str, Channel]
    take: str
    index: int


@dataclass(frozen=True)
class Recording:
    """A recording, found but not yet read.

    Attributes:
        path: its folder.
        layout: which layout it has.
        takes: in order.
        fps: frames per second; None if the videos say it.
        world: units and axes.
        plates: camera to a picture of the empty scene.
        static: the ring around the motionless head; None if there is none.
        gravity: in the recording's world, m/s^2; None for 9.81 downwards.
        background: sRGB in [0, 1] that the pictures stand on; None if they show their own.
        camera_notes: what the recording says of its cameras, kept for the manifest.
        notes: what the user should know.
    """

    path: Path
    layout: str
    takes: tuple[Take, ...]
    fps: float | None = None
    world: World = field(default_factory=World)
    plates: Mapping[str, Path] = field(default_factory=dict)
    static: StaticRing | None = None
    gravity: tuple[float, float, float] | None = None
    background: tuple[float, float, float] | None = None
    camera_notes: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
