"""Motion signals to network conditions of a common range."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.errors import DynhairError
from dynhair.motion.signals import MotionSignals

OMEGA_FLOOR = 0.05
"""rad/s: an axis that never turned faster than this in the training set is not magnified any further."""

ALPHA_FLOOR = 0.5
"""rad/s^2: the same for the angular acceleration."""


class SignalNormalizer(nn.Module):
    """Divides motion signals by their largest magnitudes in the training set (paper, "Motion conditioning").

    The maxima are per axis of the head. An axis that hardly moved would turn tracking noise into full-scale conditions,
    so maxima are never less than a physical floor. The maxima are buffers: they are saved with the model.

    Args:
        omega_max: largest angular velocity about each axis, rad/s; 1 if not given.
        alpha_max: largest angular acceleration about each axis, rad/s^2; 1 if not given.
    """

    omega_max: Tensor
    alpha_max: Tensor

    def __init__(
        self, omega_max: Float[Tensor, "3"] | None = None, alpha_max: Float[Tensor, "3"] | None = None
    ) -> None:
        super().__init__()
        ones = torch.ones(3)
        self.register_buffer("omega_max", (ones if omega_max is None else omega_max).clamp_min(OMEGA_FLOOR))
        self.register_buffer("alpha_max", (ones if alpha_max is None else alpha_max).clamp_min(ALPHA_FLOOR))

    @classmethod
    def fit(cls, signals: Sequence[MotionSignals]) -> SignalNormalizer:
        """Take the maxima over the motions of the training set.

        Args:
            signals: the motion of each training segment.

        Raises:
            DynhairError: there are none.
        """
        if not signals:
            raise DynhairError("no motion to normalise by", expected="at least one training segment")
        omega = torch.cat([s.omega for s in signals]).abs().amax(dim=0)
        alpha = torch.cat([s.alpha for s in signals]).abs().amax(dim=0)
        return cls(omega, alpha)

    def forward(self, signals: MotionSignals) -> Float[Tensor, "f 9"]:
        """Concatenate omega and alpha (both clamped to [-1, 1]) and gravity, frame by frame."""
        omega = (signals.omega / self.omega_max).clamp(-1, 1)
        alpha = (signals.alpha / self.alpha_max).clamp(-1, 1)
        return torch.cat([omega, alpha, signals.gravity], dim=-1)
