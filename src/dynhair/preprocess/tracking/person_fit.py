"""Finding what all frames share: the head's identity and where landmarks lie on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from dynhair.preprocess.tracking.anchored_head import AnchoredHead, Person
from dynhair.preprocess.tracking.expression_prior import ExpressionPrior
from dynhair.preprocess.tracking.frame_equations import flat, frame_columns, in_head_frame
from dynhair.preprocess.tracking.head_motion import POSE, HeadMotion
from dynhair.preprocess.tracking.levenberg import minimise
from dynhair.preprocess.tracking.reprojection import Reprojection

_CHUNK = 32  # frames whose equations are made at a time
_OFFSET_LENGTH = 0.04  # metres: about an eye's width
_OFFSET_SMOOTH = 0.8  # of the variance
_SHAPE_DEVIATION = 3e-3  # metres: what a linear model leaves of a person's shape
_ITERATIONS = 12


@dataclass(frozen=True)
class PersonProblem:
    """Fitting person and motion to the landmarks of frames that know nothing of each other.

    The scale is taken as known, for it is at odds with the priors: without any gain in truth, larger expressions fit
    noise at the same price. The person is found without the temporal prior, which would favour small heads: they move
    less.

    Attributes:
        head: model of the landmarks.
        data: the landmarks.
        confidence: factor on the landmarks' cost.
        expression_prior: of each frame.
        offset_precision: inverse of the covariance of landmarks' offsets, the same for x, y and z, 1 / metre^2.
    """

    head: AnchoredHead
    data: Reprojection
    confidence: float
    expression_prior: ExpressionPrior
    offset_precision: Float[ndarray, "n n"]

    def cost(self, state: tuple[Person, HeadMotion]) -> float:
        """Negative log-posterior."""
        person, motion = state
        points = motion.to_world(self.head.points(person, motion.expressions))
        offsets = (person.offsets * (self.offset_precision @ person.offsets)).sum()
        prior = self.expression_prior.cost(motion.expressions) + float((person.identity**2).sum() + offsets) / 2
        return self.confidence * self.data.cost(points) + prior

    def linearised(self, state: tuple[Person, HeadMotion]) -> Callable[[float], tuple[Person, HeadMotion]]:
        """The damped Gauss-Newton step: frames' own unknowns are eliminated first (Schur's complement)."""
        person, motion = state
        equations = [
            self._equations(person, motion, slice(start, start + _CHUNK))
            for start in range(0, len(motion.rotations), _CHUNK)
        ]
        own_gradient, own, coupling = (np.concatenate(parts) for parts in zip(*(e[:3] for e in equations), strict=True))
        shared_gradient, shared = (sum(parts) for parts in zip(*(e[3:] for e in equations), strict=True))
        identity_count = len(person.identity)
        prior = np.zeros_like(shared)
        prior[:identity_count, :identity_count] = np.eye(identity_count)
        prior[identity_count:, identity_count:] = np.kron(self.offset_precision, np.eye(3))
        shared_gradient = shared_gradient + prior @ np.concatenate([person.identity, person.offsets.ravel()])
        shared = shared + prior

        def step(damping: float) -> tuple[Person, HeadMotion]:
            solved = np.linalg.solve(_damped(own, damping), np.concatenate([coupling, own_gradient[..., None]], -1))
            transposed = flat_frames(coupling).T
            reduced = _damped(shared, damping) - transposed @ flat_frames(solved[..., :-1])
            change = np.linalg.solve(reduced, transposed @ solved[..., -1].ravel() - shared_gradient)
            frames = -solved[..., -1] - solved[..., :-1] @ change
            identity, offsets = np.split(change, [identity_count])
            moved = Person(person.scale, person.identity + identity, person.offsets + offsets.reshape(-1, 3))
            return moved, motion.moved(frames)

        return step

    def solve(self, person: Person, motion: HeadMotion) -> tuple[Person, HeadMotion]:
        """The most likely person and motion near a first guess."""
        return minimise((person, motion), self.cost, self.linearised, _ITERATIONS)

    def _equations(self, person: Person, motion: HeadMotion, frames: slice) -> tuple[ndarray, ...]:
        """Gradient and curvature of a chunk: frames' own, coupling with what is shared, and what is shared."""
        motion = motion.at(frames)
        points = self.head.points(person, motion.expressions)
        gradient, curvature = in_head_frame(self.data.at(frames).linearised(motion.to_world(points)), motion)
        gradient, curvature = self.confidence * gradient, self.confidence * curvature
        own = frame_columns(self.head, person, motion, points)
        identity = np.broadcast_to(
            person.scale * self.head.identity_modes, (len(points), *self.head.identity_modes.shape)
        )
        columns = np.concatenate([own, identity], -1)
        pulled = curvature @ columns  # (f, n, 3, unknowns but the offsets)
        unknowns = own.shape[-1]
        normal = flat(columns).swapaxes(-1, -2) @ flat(pulled)
        sums = (flat(columns).swapaxes(-1, -2) @ gradient.reshape(len(points), -1, 1))[..., 0]

        prior_gradient, prior_curvature = self.expression_prior.at(frames).linearised(motion.expressions)
        own_gradient, own_curvature = sums[:, :unknowns], normal[:, :unknowns, :unknowns]
        own_gradient[:, POSE:] += prior_gradient
        own_curvature[:, range(POSE, unknowns), range(POSE, unknowns)] += prior_curvature

        to_offsets = person.scale * flat(pulled).swapaxes(-1, -2)  # (f, unknowns, 3 n)
        few = normal[:, unknowns:, unknowns:].sum(0)
        few_to_offsets = to_offsets[:, unknowns:].sum(0)
        offsets = _block_diagonal(person.scale**2 * curvature.sum(0))
        return (
            own_gradient,
            own_curvature,
            np.concatenate([normal[:, :unknowns, unknowns:], to_offsets[:, :unknowns]], -1),
            np.concatenate([sums[:, unknowns:].sum(0), person.scale * gradient.sum(0).ravel()]),
            np.block([[few, few_to_offsets], [few_to_offsets.T, offsets]]),
        )


def offset_precision(places: Float[ndarray, "n 3"], deviations: Float[ndarray, " n"]) -> Float[ndarray, "n n"]:
    """What is expected of the offsets of landmarks: that neighbours have nearly the same.

    Offsets come from how a detector understands a face and from shape that the model lacks: both vary slowly over the
    face. Counted as independent, a hundred landmarks that are all a little off would outvote the prior of the identity,
    and a wrong identity comes with a wrong pose.

    Args:
        places: of the landmarks on the average head, metres.
        deviations: expected distance of each landmark from its anchor, metres.
    """
    squares = ((places[:, None] - places) ** 2).sum(-1)
    smooth = _OFFSET_SMOOTH * np.exp(-squares / (2 * _OFFSET_LENGTH**2))
    total = np.hypot(deviations, _SHAPE_DEVIATION)
    covariance = (smooth + (1 - _OFFSET_SMOOTH) * np.eye(len(places))) * np.outer(total, total)
    return np.linalg.inv(covariance)


def flat_frames(blocks: Float[ndarray, "f u s"]) -> Float[ndarray, "fu s"]:
    """The unknowns of all frames in one axis."""
    return blocks.reshape(-1, blocks.shape[-1])


def _damped(curvature: Float[ndarray, "*b u u"], damping: float) -> Float[ndarray, "*b u u"]:
    diagonal = np.arange(curvature.shape[-1])
    damped = curvature.copy()
    damped[..., diagonal, diagonal] *= 1 + damping
    damped[..., diagonal, diagonal] += 1e-9  # a frame that no view has seen
    return damped


def _block_diagonal(blocks: Float[ndarray, "n 3 3"]) -> Float[ndarray, "n3 n3"]:
    count = len(blocks)
    dense = np.zeros((count, 3, count, 3))
    dense[range(count), :, range(count)] = blocks
    return dense.reshape(3 * count, 3 * count)
