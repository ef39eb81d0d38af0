"""Which expression coefficients get a slider, and how far it goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from dynhair.avatar import Avatar
from dynhair.capture import HeadTrack

UNSEEN_REACH = 1.0
"""How far a slider goes where no motion tells how far the coefficient went."""


@dataclass(frozen=True)
class ExpressionSlider:
    """One coefficient's.

    Attributes:
        index: of the coefficient.
        label: its name in the face model, or its number.
        reach: largest change to either side.
    """

    index: int
    label: str
    reach: float


def expression_sliders(avatar: Avatar, tracks: Sequence[HeadTrack], count: int = 6) -> list[ExpressionSlider]:
    """The coefficients that move the face most, strongest first.

    How strong one is: how far the head's own modes displace Gaussians for it, times how far it went in the motions.

    Args:
        avatar: whose head.
        tracks: motions with expressions of the avatar's face model; may be none.
        count: how many at most.
    """
    modes, size = avatar.head.modes, avatar.head.expression_size
    reaches = np.full(size, UNSEEN_REACH)
    if tracks:
        seen = np.concatenate([track.expressions for track in tracks])
        reaches = np.abs(seen - np.median(seen, 0)).max(0).astype(np.float64)
    strengths = torch.zeros(size)
    strengths[modes.coefficients.long().cpu()] = modes.offsets.detach().square().mean((1, 2)).sqrt().cpu()
    scores = reaches * (strengths.numpy() if strengths.any() else 1.0)
    strongest = [int(index) for index in np.argsort(-scores, kind="stable") if scores[index] > 0][:count]
    told = avatar.expression_basis.names if avatar.expression_basis else ()
    names = told or [""] * size
    return [
        ExpressionSlider(index, names[index] or f"coefficient {index}", _round(reaches[index])) for index in strongest
    ]


def _round(reach: float) -> float:
    """To two digits, for a label."""
    return float(f"{reach:.2g}")
