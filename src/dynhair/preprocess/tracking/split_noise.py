"""The noise of tracked rotations, told by halves of the cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from dynhair.preprocess.tracking.head_motion import HeadMotion
from dynhair.preprocess.tracking.noise import RotationNoise
from dynhair.preprocess.tracking.smoother import SmoothingProblem
from dynhair.preprocess.tracking.smoothness import turns_between


def split_noise(problems: Sequence[SmoothingProblem], motions: Sequence[HeadMotion]) -> RotationNoise | None:
    """Track every second camera and the others apart, and compare.

    What two halves disagree on is noise of both; their mean, which is nearly the track of all, has half the difference
    as its noise. Other than the posterior covariance this counts errors that go with how a camera sees the face, such
    as hair that hides half of it, for they last many frames. What deceives all cameras alike still goes unnoticed.

    Args:
        problems: of each take.
        motions: their solutions.

    Returns:
        None if in no take both halves see the face in five frames.
    """
    omegas, alphas = [], []
    for problem, motion in zip(problems, motions, strict=True):
        halves = [_without(problem, first) for first in (0, 1)]
        common = np.logical_and(*(_seen(half) for half in halves))
        if common.sum() < 5:
            continue
        (omega, alpha), (other_omega, other_alpha) = (
            _derivatives(half.solve(motion).rotations, problem.smoothness.fps) for half in halves
        )
        omegas.append((omega - other_omega)[common[1:-1]])
        alphas.append((alpha - other_alpha)[common[2:-2]])
    if not omegas:
        return None
    return RotationNoise(*(float(np.sqrt((np.concatenate(d) ** 2).mean()) / 2) for d in (omegas, alphas)))


def _without(problem: SmoothingProblem, first: int) -> SmoothingProblem:
    scores = problem.data.scores.copy()
    scores[:, first::2] = 0
    return replace(problem, data=replace(problem.data, scores=scores))


def _seen(problem: SmoothingProblem) -> Bool[ndarray, " f"]:
    return np.any(problem.data.scores > 0, axis=(1, 2))


def _derivatives(rotations: Float[ndarray, "f 3 3"], fps: float) -> tuple[Float[ndarray, "g 3"], Float[ndarray, "h 3"]]:
    """Central differences, as the motion signals take them; in the world's frame."""
    turns = turns_between(rotations)
    omega = (turns[1:] + turns[:-1]) * fps / 2
    return omega, (omega[2:] - omega[:-2]) * fps / 2
