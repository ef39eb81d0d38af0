"""How the tips of hair move in the head's frame: their speed, and their mean position."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError


class TipMotion:
    """Keeps four numbers of each consecutive frame of a motion.

    Args:
        fps: frames per second.
    """

    def __init__(self, fps: float) -> None:
        if not fps > 0:
            raise DynhairError(f"the frame rate is {fps}", expected="a positive number")
        self._fps = fps
        self._last: Float[Tensor, "n 3"] | None = None
        self._speeds: list[float] = []
        self._means: list[Float[Tensor, "3"]] = []

    def add(self, tips: Float[Tensor, "n 3"]) -> None:
        """Add the next frame.

        Args:
            tips: in the head's frame, metres: of strands, or where `HairMotion.tips` sees them.
        """
        tips = tips.detach().cpu().double()
        speed = torch.nan if self._last is None else ((tips - self._last).norm(dim=-1).mean() * self._fps).item()
        self._last = tips
        self._speeds.append(speed)
        self._means.append(tips.mean(dim=0))

    @property
    def speeds(self) -> Float[Tensor, " f"]:
        """Mean speed of the tips from the frame before to each frame, m/s; ``nan`` in the first."""
        return torch.tensor(self._speeds, dtype=torch.float64)

    @property
    def path(self) -> Float[Tensor, "f 3"]:
        """Mean position of the tips in each frame, metres."""
        return torch.stack(self._means) if self._means else torch.zeros(0, 3, dtype=torch.float64)
