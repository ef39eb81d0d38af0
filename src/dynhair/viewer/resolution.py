"""How large a picture may be so that looking stays fluent."""

from __future__ import annotations

from dataclasses import dataclass

HEIGHTS = (256, 320, 384, 448, 512, 640, 768, 896, 1080)
"""Pixels. Smaller pictures are hardly quicker: what they cost then is the Gaussians, not the pixels."""

BUDGET = 1 / 15
"""Seconds for posing, drawing and encoding a picture while something moves."""

_MEMORY = 0.7  # of the running mean of the seconds


@dataclass
class Resolution:
    """Chooses a picture's height from how long the ones before took.

    Attributes:
        height: while something moves, pixels.
        seconds: running mean of what a picture of this height took; None before the first.
    """

    height: int = 384
    seconds: float | None = None

    def moving(self, canvas: int) -> int:
        """Height of a picture while something moves, on a canvas of the given height."""
        return min(self.height, canvas)

    def still(self, canvas: int) -> int:
        """Height of a picture when nothing moves."""
        return min(canvas, HEIGHTS[-1])

    def took(self, seconds: float) -> None:
        """Learn from a picture of the current height; go one rung down where it was too slow, up where there is room.

        A step up is taken when even a picture whose whole cost grew with its pixels would keep to the budget, so that
        the size does not swing.
        """
        mean = seconds if self.seconds is None else _MEMORY * self.seconds + (1 - _MEMORY) * seconds
        rung = HEIGHTS.index(self.height)
        if mean > 1.25 * BUDGET and rung > 0:
            self.height, self.seconds = HEIGHTS[rung - 1], None
        elif rung + 1 < len(HEIGHTS) and mean * (HEIGHTS[rung + 1] / self.height) ** 2 < 0.9 * BUDGET:
            self.height, self.seconds = HEIGHTS[rung + 1], None
        else:
            self.seconds = mean
