"""How sure landmarks are and how much heads jerk, told from the landmarks alone; and what noise of the motion follows.

Around a smoothed motion the landmarks' cost is quadratic in each frame's pose: every frame is a measurement of its pose
with a known shape of error. Two things are not known: by what factor that cost is too sure or not sure enough of
changes from frame to frame, and how strong the jerk is. They are found by maximum likelihood of the
measurements under the smooth prior (empirical Bayes). All is linear and Gaussian, so the likelihood is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import minimize

from dynhair.preprocess.tracking.banded import BlockBanded
from dynhair.preprocess.tracking.frame_equations import FrameEquations
from dynhair.preprocess.tracking.head_motion import POSE, HeadMotion
from dynhair.preprocess.tracking.smoothness import REACH, pose_smoothness, third_differences

_UNSEEN = 1e-6
_MOST_FRAMES = 200  # whose noise is averaged
_LEAST_FRAMES = 24  # of a take whose jerk is told from itself
_WIDEST = 12.0  # of logarithms of levels


@dataclass(frozen=True)
class PoseMeasurements:
    """What single frames say about their poses, expressions eliminated.

    Attributes:
        motion: the poses about which the small ones are counted.
        gradient: of the landmarks' cost with respect to small poses.
        information: curvature of that cost.
        fps: frames per second.
    """

    motion: HeadMotion
    gradient: Float[ndarray, "f 6"]
    information: Float[ndarray, "f 6 6"]
    fps: float

    @classmethod
    def of(cls, motion: HeadMotion, equations: FrameEquations, fps: float) -> PoseMeasurements:
        """Eliminate the expressions from frames' equations."""
        pose, other = slice(None, POSE), slice(POSE, None)
        coupling = equations.curvature[:, pose, other]
        right = np.concatenate([equations.curvature[:, other, pose], equations.gradient[:, other, None]], -1)
        solved = np.linalg.solve(equations.curvature[:, other, other], right)
        return cls(
            motion=motion,
            gradient=equations.gradient[:, pose] - (coupling @ solved[..., -1:])[..., 0],
            information=equations.curvature[:, pose, pose] - coupling @ solved[..., :-1],
            fps=fps,
        )

    def posterior(self, noise: NoiseLevels) -> tuple[Float[ndarray, "f 6"], BlockBanded]:
        """Gradient and curvature of landmarks and smooth prior together."""
        gradient, system = pose_smoothness(
            self.motion, noise.angular_jerk * self.fps**-2.5, noise.linear_jerk * self.fps**-2.5
        )
        blocks = system.blocks
        blocks[:, 0] += noise.confidence * self.information + _UNSEEN * np.eye(POSE)
        return gradient + noise.confidence * self.gradient, BlockBanded(blocks)


@dataclass(frozen=True)
class NoiseLevels:
    """Unknown strengths.

    Attributes:
        confidence: factor on the landmarks' information.
        angular_jerk: rad / s^2.5.
        linear_jerk: m / s^2.5.
    """

    confidence: float
    angular_jerk: float
    linear_jerk: float


def negative_log_likelihood(takes: Sequence[PoseMeasurements], noise: NoiseLevels) -> float:
    """Of the measured poses, poses themselves integrated out; up to a constant."""
    total = 0.0
    for take in takes:
        gradient, system = take.posterior(noise)
        factor = system.factorised()
        at_motion = _cost_at_motion(take, noise)
        least = at_motion - (gradient * factor.solve(gradient)).sum() / 2
        jerks = 3 * max(len(take.gradient) - REACH + 1, 0)
        log_prior = -2 * jerks * (np.log(noise.angular_jerk) + np.log(noise.linear_jerk))
        log_data = POSE * (np.abs(take.information).max((1, 2)) > 1).sum() * np.log(noise.confidence)
        total += least + (factor.log_determinant() - log_prior - log_data) / 2
    return float(total)


def estimate_noise(takes: Sequence[PoseMeasurements], start: NoiseLevels) -> list[NoiseLevels]:
    """The most likely levels: confidence from all takes together, the jerk of each take then from the take alone.

    Takes that are too short say nothing, and are taken for average; without any longer one, the start is the answer.

    Args:
        takes: measured poses.
        start: a first guess.
    """
    long = [take for take in takes if len(take.gradient) >= _LEAST_FRAMES]
    if not long:
        return [start] * len(takes)
    average = NoiseLevels(*_most_likely(long, _values(start)))

    def of_take(take: PoseMeasurements) -> NoiseLevels:
        if len(take.gradient) < _LEAST_FRAMES:
            return average
        confidence, *jerks = _values(average)
        return NoiseLevels(confidence, *_most_likely([take], jerks, confidence))

    return [of_take(take) for take in takes]


def _most_likely(takes: Sequence[PoseMeasurements], start: Sequence[float], *known: float) -> list[float]:
    """Levels after the known ones, by Nelder and Mead's method on their logarithms."""
    logs = np.log(start)
    simplex = logs + np.vstack([np.zeros(len(logs)), np.eye(len(logs))])

    def levels(x: Float[ndarray, " l"]) -> list[float]:
        return [float(value) for value in np.exp(np.clip(x, -_WIDEST, _WIDEST))]

    found = minimize(
        lambda x: negative_log_likelihood(takes, NoiseLevels(*known, *levels(x))),
        logs,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.02, "fatol": 0.05},
    )
    return levels(found.x)


def _values(levels: NoiseLevels) -> tuple[float, float, float]:
    return levels.confidence, levels.angular_jerk, levels.linear_jerk


@dataclass(frozen=True)
class RotationNoise:
    """Root mean square of the noise that is left in a tracked rotation's derivatives, over frames and axes.

    Central differences, as the motion signals take them.

    Attributes:
        omega: of the angular velocity, rad/s.
        alpha: of the angular acceleration, rad/s^2.
    """

    omega: float
    alpha: float


def posterior_noise(takes: Sequence[PoseMeasurements], levels: Sequence[NoiseLevels]) -> RotationNoise | None:
    """What the posterior covariance says; None if no take has the five frames of an angular acceleration."""
    omegas, alphas = [], []
    for take, noise in zip(takes, levels, strict=True):
        frames = np.arange(2, len(take.gradient) - 2)
        if not len(frames):
            continue
        chosen = frames[np.unique(np.linspace(0, len(frames) - 1, _MOST_FRAMES).astype(int))]
        factor = take.posterior(noise)[1].factorised()
        for weights, variances, power in (
            ({1: 0.5, -1: -0.5}, omegas, 1),
            ({2: 0.25, 0: -0.5, -2: 0.25}, alphas, 2),
        ):
            wanted = np.zeros((len(take.gradient), POSE, len(chosen), 3))
            for offset, weight in weights.items():
                for axis in range(3):
                    wanted[chosen + offset, axis, np.arange(len(chosen)), axis] = weight * take.fps**power
            flat = wanted.reshape(*wanted.shape[:2], -1)
            variances.append((flat * factor.solve(flat)).sum((0, 1)))
    if not omegas:
        return None
    return RotationNoise(*(float(np.sqrt(np.concatenate(v).mean())) for v in (omegas, alphas)))


def _cost_at_motion(take: PoseMeasurements, noise: NoiseLevels) -> float:
    """The quadratic model's cost where no frame moves: prior, and data above its least."""
    deviations = np.repeat([noise.angular_jerk, noise.linear_jerk], 3) * take.fps**-2.5
    prior = ((third_differences(take.motion) / deviations) ** 2).sum() / 2
    seen = take.information + _UNSEEN * np.eye(POSE)
    data = (take.gradient * np.linalg.solve(seen, take.gradient[..., None])[..., 0]).sum() / 2
    return float(prior + noise.confidence * data)
