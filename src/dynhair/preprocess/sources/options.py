"""What to take from a recording, and in which size; light to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dynhair.errors import DynhairError

Crop = tuple[int, int, int, int] | Literal["square"] | None
Size = tuple[int, int] | int | None
Up = Literal["x", "-x", "y", "-y", "z", "-z"]


@dataclass(frozen=True)
class ImportOptions:
    """What to take from a recording, and in which size.

    Attributes:
        takes: Names of the takes to use; all by default.
        cameras: Names of the cameras to use; all by default.
        start: First frame of every take, counted from 0.
        stop: Frame of every take before which to stop; its end by default.
        stride: Use every n-th frame; the frame rate is divided by it.
        crop: x, y, width and height in pixels of the undistorted picture, or "square" for the largest in the middle.
        size: Length of the longer side in pixels, or width and height; as filmed by default.
        test_takes: Names of the takes that are held out. By default what the recording says, else the take called
            FREE, else the last; a single take trains.
        metres_per_unit: Length of the recording's unit; as its calibration says by default, or 1.
        up: The axis of the recording's world that points up; as its calibration says by default, or y.
    """

    takes: tuple[str, ...] | None = None
    cameras: tuple[str, ...] | None = None
    start: int = 0
    stop: int | None = None
    stride: int = 1
    crop: Crop = None
    size: Size = None
    test_takes: tuple[str, ...] | None = None
    metres_per_unit: float | None = None
    up: Up | None = None

    def __post_init__(self) -> None:
        if self.takes == () or self.cameras == ():
            raise DynhairError("no take or no camera is to be used", expected="one name or more, or None for all")
        if self.start < 0 or (self.stop is not None and self.stop <= self.start):
            raise DynhairError(f"the frames from {self.start} to {self.stop}", expected="0 <= start < stop")
        if self.stride < 1:
            raise DynhairError(f"a stride of {self.stride}", expected="1 or more")
        if self.metres_per_unit is not None and not 0 < self.metres_per_unit < float("inf"):
            raise DynhairError(f"{self.metres_per_unit} metres per unit", expected="a number above 0")
        sides = () if self.size is None else (self.size,) if isinstance(self.size, int) else self.size
        if any(side < 1 for side in sides):
            raise DynhairError(f"a size of {self.size}", expected="pixels, 1 or more")
