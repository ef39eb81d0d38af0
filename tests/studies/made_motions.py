"""Motions of a few made-up strands, which swing in one mode."""

from __future__ import annotations

import numpy as np
import torch
from studies.hair_motion.motions import FPS, head_motion
from studies.hair_motion.recordings import GRAVITY, Recorded

from dynhair.capture import HeadTrack
from dynhair.motion import motion_signals


def hanging(strands: int = 6, points: int = 5) -> torch.Tensor:
    generator = torch.Generator().manual_seed(3)
    roots = 0.08 * torch.randn(strands, 1, 3, generator=generator)
    steps = torch.tensor([0.0, -0.03, 0.0]) + 0.004 * torch.randn(strands, points, 3, generator=generator)
    return roots + steps.cumsum(1)


def made_motion(name: str, canonical: torch.Tensor | None = None) -> Recorded:
    """Points lag behind the head's yaw by a fading share, the more the nearer they are to the tip."""
    motion = head_motion(name)
    track = HeadTrack(
        rotations=motion.rotations,
        translations=motion.translations,
        expressions=np.zeros((len(motion.rotations), 0), np.float32),
        fps=FPS,
        gravity=GRAVITY,
    )
    signals = motion_signals(track)
    lag = [torch.zeros(3)]
    for omega in signals.omega[1:]:
        lag.append(0.9 * lag[-1] - omega / FPS)
    hair = hanging() if canonical is None else canonical
    along = torch.linspace(0, 1, hair.shape[1])[:, None]
    arms = torch.linalg.cross(
        torch.stack(lag)[:, None, None].expand(-1, *hair.shape), hair[None].expand(75, -1, -1, -1)
    )
    return Recorded(name, hair, along * arms, signals)
