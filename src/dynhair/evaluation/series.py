"""Figures that are followed over time, a value a frame, and the file that holds them: ``series.npz``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32
from torch import Tensor

from dynhair.capture import Segment
from dynhair.storage import atomic_file

SERIES = (
    "time",
    "tip_speed",
    "tip_speed_truth",
    "hair_tiou",
    "hair_tiou_truth",
    "hair_iou",
    "tip_error_mm",
)
"""What is followed: seconds since the segment's first frame; the speed of the strands' tips in the head's frame from
the frame before to this, m/s, mean over strands; overlap with the frame before and with the truth, means over views;
error of the tips, millimetres."""


class Series:
    """The series of one segment.

    Args:
        segment: of a capture.
        fps: frames per second.

    Attributes:
        values: by name, over all frames of the segment; ``nan`` where not defined, or not evaluated.
    """

    def __init__(self, segment: Segment, fps: float) -> None:
        self.values: dict[str, Float32[np.ndarray, " f"]] = {
            name: np.full(segment.count, np.nan, np.float32) for name in SERIES
        }
        self.values["time"][:] = np.arange(segment.count) / fps

    def record(self, name: str, index: int, value: float) -> None:
        """Set one frame's value."""
        self.values[name][index] = value

    def set(self, name: str, values: Float[Tensor, " f"]) -> None:
        """Set all frames' values."""
        self.values[name][:] = values.numpy()


def write_series(path: Path, segments: Mapping[str, Mapping[str, Float32[np.ndarray, " f"]]]) -> None:
    """Write all segments' series, ``<segment>/<name>``, atomically."""
    arrays = {f"{segment}/{name}": values for segment, series in segments.items() for name, values in series.items()}
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
