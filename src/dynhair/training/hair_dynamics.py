"""The hair of the training motions against physics: some strands in a frame and its two neighbours."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar import Hair
from dynhair.capture import Capture, Segment
from dynhair.losses import HairSprings, dynamics_loss
from dynhair.motion import HeadForces, head_forces, motion_windows
from dynhair.training.frames import pull_at_rest

LEAST_FRAMES = 3
"""Of a segment that has accelerations."""


class HairDynamics(nn.Module):
    """What hair swings by, and the forces on it in every frame.

    Args:
        hair: that swings, on the device that it is to be trained on.
        capture: gives tracks, gravity, and the frame in which the hair is at rest.
        segments: the training segments.
        conditions: normalised motion conditions of each.
        strands: how many are seen in a step, at most.
    """

    def __init__(
        self,
        hair: Hair,
        capture: Capture,
        segments: Sequence[Segment],
        conditions: Sequence[Float[Tensor, "_ c"]],
        strands: int,
    ) -> None:
        super().__init__()
        rest = hair(None).detach()
        self._device = rest.device
        self.springs = HairSprings(rest)
        self._conditions, self._strands, self._fps = conditions, strands, capture.fps
        self._forces = [self._forces_of(capture, segment) for segment in segments]
        self._pull_at_rest = pull_at_rest(capture).to(self._device)

    def forward(self, hair: Hair, segment: int, index: int, generator: torch.Generator) -> Float[Tensor, ""] | None:
        """:func:`dynhair.losses.dynamics_loss` of strands drawn at random.

        Args:
            hair: that swings.
            segment: number of the segment.
            index: of the frame in it.
            generator: of random numbers, on the CPU.

        Returns:
            None in a segment's first and last frame, of which one neighbour is missing.
        """
        forces = self._forces[segment]
        if not 0 < index < len(forces) - 1:
            return None
        chosen = torch.randperm(len(hair.strands), generator=generator)[: self._strands].to(self._device)
        frames = [index - 1, index, index + 1]
        windows = motion_windows(self._conditions[segment], frames, hair.deformer.config.history)
        rest = hair(None).detach()[chosen]
        moved = hair.some(windows, chosen)
        return dynamics_loss(moved, rest, self.springs, forces[index], self._pull_at_rest, self._fps)

    def _forces_of(self, capture: Capture, segment: Segment) -> list[HeadForces]:
        if segment.count < LEAST_FRAMES:
            return []
        return [
            HeadForces(*(part.to(self._device) for part in forces)) for forces in head_forces(capture.track(segment))
        ]
