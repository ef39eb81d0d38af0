"""Motion signals to network conditions of a common range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.config import DeformerConfig
from dynhair.errors import DynhairError
from dynhair.motion.rotations import so3_exp, so3_log
from dynhair.motion.signals import MotionSignals

FLOORS = {"omega": 0.05, "alpha": 0.5, "rotation": 0.05, "translation": 0.01, "turn": 0.05}
"""rad/s, rad/s^2, rad, metres, rad: an axis with a smaller range in the training set is not magnified any further."""

GRAVITY = 9.81
"""m/s^2, what a pull is measured in."""


class HeadAtRest(NamedTuple):
    """The head while the hair is at rest.

    Attributes:
        rotation: head frame to world.
        pull: of gravity, in the head frame, m/s^2.
    """

    rotation: Float[Tensor, "3 3"]
    pull: Float[Tensor, "3"]


def signal_names(config: DeformerConfig) -> tuple[str, ...]:
    """Which of the :class:`MotionSignals` the hair sees, in the order of the conditions' columns.

    The paper's are angular velocity, angular acceleration and gravity; pose, and the lack of any, are its ablations
    (table 2). Modes and strands see the pull in the place of gravity, and may see the head's turn since rest, which is
    a rotation vector in its frame.
    """
    if config.kind == "paper" and config.signals == "pose":
        motion = ("rotation", "translation")
    else:
        motion = ("omega", "alpha") if config.acceleration else ("omega",)
    if config.gravity:
        motion = (*motion, "gravity" if config.kind == "paper" else "pull")
    return (*motion, "turn") if config.kind != "paper" and config.turn else motion


class SignalNormalizer(nn.Module):
    """Divides motion signals by their largest magnitudes in the training set (paper, "Motion conditioning").

    The maxima are per axis. An axis that hardly moved would turn tracking noise into full-scale conditions, so maxima
    are never less than a physical floor. Gravity is a direction and stays as it is; translations count from their mean,
    a turn from the head at rest, and a pull, in gravities, from that on it. All that is buffers, saved with the model;
    a fresh normalizer divides by one.

    Dynamics of strands know physical units, whatever the training set: for them nothing is divided.

    Args:
        config: which signals the hair sees; the paper's by default.
    """

    def __init__(self, config: DeformerConfig | None = None) -> None:
        super().__init__()
        config = config or DeformerConfig()
        self.names = signal_names(config)
        self.physical = config.kind == "strands"
        for name in self.names:
            if name in FLOORS and not self.physical:
                self.register_buffer(f"{name}_max", torch.ones(3))
        if "translation" in self.names:
            self.register_buffer("translation_mean", torch.zeros(3))
        if "pull" in self.names:
            self.register_buffer("pull_at_rest", torch.zeros(3))
        if "turn" in self.names:
            self.register_buffer("rest_rotation", torch.eye(3))

    @classmethod
    def fit(
        cls,
        signals: Sequence[MotionSignals],
        config: DeformerConfig | None = None,
        rest: HeadAtRest | None = None,
    ) -> SignalNormalizer:
        """Take the maxima over the motions of the training set.

        Args:
            signals: the motion of each training segment.
            config: which signals the hair sees; the paper's by default.
            rest: the head at rest; as in the first frame by default.

        Raises:
            DynhairError: there are none.
        """
        if not signals:
            raise DynhairError("no motion to normalise by", expected="at least one training segment")
        normalizer = cls(config)
        if "translation" in normalizer.names:
            normalizer.get_buffer("translation_mean").copy_(torch.cat([s.translation for s in signals]).mean(0))
        if "pull" in normalizer.names:
            normalizer.get_buffer("pull_at_rest").copy_(signals[0].pull[0] if rest is None else rest.pull)
        if "turn" in normalizer.names:
            rotation = so3_exp(signals[0].rotation[0]) if rest is None else rest.rotation
            normalizer.get_buffer("rest_rotation").copy_(rotation)
        for name in () if normalizer.physical else normalizer.names:
            if name in FLOORS:
                largest = torch.cat([normalizer._centred(s, name) for s in signals]).abs().amax(0)
                normalizer.get_buffer(f"{name}_max").copy_(largest.clamp_min(FLOORS[name]))
        return normalizer

    def forward(self, signals: MotionSignals) -> Float[Tensor, "f c"]:
        """Concatenate the signals frame by frame.

        What has been scaled is clamped to [-1, 1]; gravity and pull are not, nor is anything in physical units.
        """
        return torch.cat([self._scaled(signals, name) for name in self.names], dim=-1)

    def _scaled(self, signals: MotionSignals, name: str) -> Float[Tensor, "f 3"]:
        values = self._centred(signals, name)
        if name == "pull":
            return (values - self.get_buffer("pull_at_rest")) / GRAVITY
        if self.physical or name not in FLOORS:
            return values
        return (values / self.get_buffer(f"{name}_max")).clamp(-1, 1)

    def _centred(self, signals: MotionSignals, name: str) -> Float[Tensor, "f 3"]:
        if name == "turn":
            return so3_log(self.get_buffer("rest_rotation").T @ so3_exp(signals.rotation))
        values = getattr(signals, name)
        return values - self.get_buffer("translation_mean") if name == "translation" else values
