"""Hair that swings in damped modes: a deformer with memory, beyond the paper's.

The paper's network hears the last frames; long hair swings and settles for longer than these. A mode is a damped
oscillator, x'' + 2 d w x' + w^2 x = w^2 F(t), driven by what accelerates matter in the head's frame, and the hair's
displacement is a sum of mode shapes, each times its mode's x. At rest F is nothing and the hair canonical; nothing can
drift, for an oscillator forgets.
"""

from __future__ import annotations

import itertools
import math

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.chunked import PointLayer
from dynhair.avatar.deformer import PointwiseDeformer
from dynhair.config import DeformerConfig
from dynhair.motion import signal_names

SLOWEST, FASTEST = 0.1, 0.85
"""Radians a frame that modes begin at: half a hertz to four at 30 frames a second."""

DAMPING = 0.4  # ratio d that modes begin with
LEAST_DAMPING, MOST_DAMPING = 0.02, 0.98


class Oscillators(nn.Module):
    """Damped oscillators, one a mode.

    Frequencies are in radians a frame: as the paper's network, modes belong to a frame rate.

    Args:
        count: how many.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        self.log_frequency = nn.Parameter(torch.linspace(math.log(SLOWEST), math.log(FASTEST), count))
        share = (DAMPING - LEAST_DAMPING) / (MOST_DAMPING - LEAST_DAMPING)
        self.damping_logit = nn.Parameter(torch.full((count,), math.log(share / (1 - share))))

    @property
    def frequency(self) -> Float[Tensor, " m"]:
        """Undamped angular frequencies, radians a frame."""
        return self.log_frequency.exp()

    @property
    def damping(self) -> Float[Tensor, " m"]:
        """Damping ratios, below 1: all swing."""
        return LEAST_DAMPING + (MOST_DAMPING - LEAST_DAMPING) * torch.sigmoid(self.damping_logit)

    def step_responses(self, frames: Float[Tensor, " t"]) -> Float[Tensor, "t m"]:
        """How far each oscillator has followed a force of 1 that set in so many frames ago."""
        decay = self.damping * self.frequency
        swing = self.frequency * (1 - self.damping.square()).sqrt()
        phase = frames[:, None] * swing
        return 1 - (-frames[:, None] * decay).exp() * (phase.cos() + decay / swing * phase.sin())

    def forward(self, forces: Float[Tensor, "t m"]) -> Float[Tensor, " m"]:
        """Where the oscillators are at the last of some frames, having been at rest under the first one's force.

        Exact for a force that is constant from one frame to the next. A closed form, for all frames at once: each
        change of the force is answered by a step response.
        """
        changes = forces.diff(dim=0)
        since = torch.arange(len(changes), 0, -1).to(forces)
        return forces[0] + (changes * self.step_responses(since)).sum(0)


class ModalDeformer(PointwiseDeformer):
    """Displacements as a sum of learned modes (see the module's text).

    The forces on the modes are linear in angular acceleration, angular velocity, its products in pairs (centrifugal
    forces), and gravity less the head's own acceleration, counted from rest. Mode shapes come from a network of a
    point's encoded canonical position and place along the strand; as they enter linearly, the modes fold into its last
    layer, and it costs as much as a network of one displacement.

    Args:
        canonical: canonical strands in the head frame, metres.
        config: sizes.
    """

    def __init__(self, canonical: Float[Tensor, "n l 3"], config: DeformerConfig) -> None:
        super().__init__(canonical, config)
        signals = 3 * len(signal_names(config))
        pairs = torch.triu_indices(3, 3)
        self.register_buffer("pairs", pairs, persistent=False)
        self.oscillators = Oscillators(config.modes)
        self.forces = nn.Linear(signals + pairs.shape[1], config.modes, bias=False)
        nn.init.normal_(self.forces.weight, std=0.5)
        sizes = (self.code.shape[-1], *[config.width] * config.layers)
        self.mlp = nn.ModuleList([nn.Linear(a, b) for a, b in itertools.pairwise(sizes)])
        self.shapes = nn.Linear(sizes[-1], 3 * config.modes)
        nn.init.normal_(self.shapes.weight, std=1e-2)  # the hair hardly moves at first
        nn.init.zeros_(self.shapes.bias)

    def parameters_by_rate(self) -> dict[str, list[nn.Parameter]]:
        """As :meth:`HairDeformer.parameters_by_rate`: the oscillators learn faster than the rest."""
        rest = [parameter for name, parameter in self.named_parameters() if not name.startswith("oscillators.")]
        return {"modes": list(self.oscillators.parameters()), "deformer": rest}

    def embedding(self, window: Float[Tensor, "t c"]) -> Float[Tensor, " modes"]:
        """The modes' amplitudes at the end of a window."""
        first, second = window[:, self.get_buffer("pairs")].unbind(1)
        return self.oscillators(self.forces(torch.cat([window, first * second], 1)))

    def layers(self, embedding: Float[Tensor, " modes"]) -> list[PointLayer]:
        """The network of the mode shapes, summed by the amplitudes in its last layer."""
        hidden = [PointLayer(layer.weight, layer.bias) for layer in self.mlp if isinstance(layer, nn.Linear)]
        weight, bias = (part.unflatten(0, (3, -1)) for part in (self.shapes.weight, self.shapes.bias))
        return [*hidden, PointLayer(torch.einsum("cmh,m->ch", weight, embedding), bias @ embedding)]
