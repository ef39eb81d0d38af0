"""Simulated motions as networks see them: canonical hair, displacements and motion signals; and what is explained."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from studies.hair_motion.motions import FPS
from torch import Tensor

from dynhair.capture import HeadTrack
from dynhair.motion import MotionSignals, motion_signals

GRAVITY = np.array([0.0, -9.81, 0.0])

MIRROR = torch.tensor([-1.0, 1.0, 1.0])
"""Reflects positions, velocities and forces in the plane that parts the head's left from its right."""

AXIAL = -MIRROR
"""Reflects turns: rotation vectors, angular velocities and angular accelerations."""

AXIAL_SIGNALS = ("omega", "alpha", "rotation")


@dataclass(frozen=True)
class Recorded:
    """One simulated motion.

    Attributes:
        name: of the motion.
        canonical: the hair at rest, head frame, metres.
        displacements: from it, in each frame, in the head's frame, metres.
        signals: the head's motion.
    """

    name: str
    canonical: Float[Tensor, "n k 3"]
    displacements: Float[Tensor, "f n k 3"]
    signals: MotionSignals


def recorded(path: Path, about_roots: bool = False) -> Recorded:
    """Read what `simulation.simulated` wrote; its first frame is the canonical hair.

    Args:
        path: of the file.
        about_roots: whether the mean of the roots is the origin of the head frame, in the place of the simulated
            head's, which other heads have elsewhere.
    """
    with np.load(path, allow_pickle=False) as arrays:
        guides, rotations, translations = (arrays[name] for name in ("guides", "rotations", "translations"))
    if about_roots:
        origin = guides[0, :, 0].mean(0)
        guides, translations = guides - origin, translations + rotations @ origin
    hair = torch.from_numpy(guides)
    track = HeadTrack(
        rotations=rotations,
        translations=translations,
        expressions=np.zeros((len(rotations), 0), np.float32),
        fps=FPS,
        gravity=GRAVITY,
    )
    return Recorded(path.stem, hair[0], hair - hair[0], motion_signals(track))


def mirrored(motion: Recorded) -> Recorded:
    """The motion of the mirrored head with mirrored hair: just as possible, and free."""
    signals = {field.name: getattr(motion.signals, field.name) for field in fields(MotionSignals)}
    return Recorded(
        name=motion.name,
        canonical=motion.canonical * MIRROR,
        displacements=motion.displacements * MIRROR,
        signals=MotionSignals(
            **{name: value * (AXIAL if name in AXIAL_SIGNALS else MIRROR) for name, value in signals.items()}
        ),
    )


def explained(predicted: Float[Tensor, "f n k 3"], true: Float[Tensor, "f n k 3"]) -> float:
    """Share of the hair's motion that is predicted: 1 less the mean error over the mean error of rigid hair.

    Raises:
        ValueError: the hair does not move.
    """
    moved = true.norm(dim=-1).mean()
    if not moved > 0:
        raise ValueError("hair that does not move cannot be explained")
    return 1 - float((predicted - true).norm(dim=-1).mean() / moved)


def mean_explained(pairs: Iterable[tuple[Tensor, Tensor]]) -> float:
    """The mean over motions of what is explained of each."""
    return float(np.mean([explained(predicted, true) for predicted, true in pairs]))
