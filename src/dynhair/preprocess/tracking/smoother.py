"""The most likely motion of a known person over a take, all frames together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from dynhair.preprocess.tracking.anchored_head import AnchoredHead, Person
from dynhair.preprocess.tracking.banded import BlockBanded
from dynhair.preprocess.tracking.expression_prior import ExpressionPrior
from dynhair.preprocess.tracking.frame_equations import FrameEquations, frame_equations
from dynhair.preprocess.tracking.head_motion import POSE, HeadMotion
from dynhair.preprocess.tracking.levenberg import minimise
from dynhair.preprocess.tracking.reprojection import Reprojection
from dynhair.preprocess.tracking.silhouette import Silhouettes
from dynhair.preprocess.tracking.smoothness import Smoothness

_ITERATIONS = 15
_UNSEEN = 1e-6  # curvature that keeps unseen ends of a short take where they are


@dataclass(frozen=True)
class SmoothingProblem:
    """Poses and expressions of one take given the person.

    Attributes:
        head: model of the landmarks.
        person: size and shape.
        data: the landmarks.
        confidence: factor on the landmarks' cost.
        expression_prior: of each frame.
        smoothness: the temporal prior.
        outline: other points of the head and the silhouettes that they must be within, if any.
    """

    head: AnchoredHead
    person: Person
    data: Reprojection
    confidence: float
    expression_prior: ExpressionPrior
    smoothness: Smoothness
    outline: tuple[AnchoredHead, Silhouettes] | None = None

    def points(self, motion: HeadMotion) -> Float[ndarray, "f n 3"]:
        """The landmarks on the head, world."""
        return motion.to_world(self.head.points(self.person, motion.expressions))

    def cost(self, motion: HeadMotion) -> float:
        """Negative log-posterior."""
        data = self.data.cost(self.points(motion))
        if self.outline is not None:
            head, silhouettes = self.outline
            data += silhouettes.cost(motion.to_world(head.points(self._bare(head), motion.expressions)))
        prior = self.expression_prior.cost(motion.expressions) + self.smoothness.cost(motion)
        return self.confidence * data + prior

    def frame_equations(self, motion: HeadMotion) -> FrameEquations:
        """Normal equations of landmarks and expression prior, frame by frame."""
        data = frame_equations(self.head, self.person, motion, self.data.linearised(self.points(motion)))
        gradient, curvature = self.confidence * data.gradient, self.confidence * data.curvature
        if self.outline is not None:
            head, silhouettes = self.outline
            person = self._bare(head)
            term = silhouettes.linearised(motion.to_world(head.points(person, motion.expressions)))
            edge = frame_equations(head, person, motion, term)
            gradient, curvature = (
                gradient + self.confidence * edge.gradient,
                curvature + self.confidence * edge.curvature,
            )
        prior_gradient, prior_curvature = self.expression_prior.linearised(motion.expressions)
        gradient[:, POSE:] += prior_gradient
        unknowns = np.arange(POSE, gradient.shape[1])
        curvature[:, unknowns, unknowns] += prior_curvature
        return FrameEquations(gradient, curvature)

    def linearised(self, motion: HeadMotion) -> Callable[[float], HeadMotion]:
        """The damped Gauss-Newton step."""
        frames = self.frame_equations(motion)
        gradient, system = self.smoothness.linearised(motion)
        gradient = gradient + frames.gradient
        blocks = system.blocks
        blocks[:, 0] += frames.curvature + _UNSEEN * np.eye(gradient.shape[1])

        def step(damping: float) -> HeadMotion:
            return motion.moved(-BlockBanded(blocks).damped(damping).factorised().solve(gradient))

        return step

    def _bare(self, head: AnchoredHead) -> Person:
        return replace(self.person, offsets=np.zeros_like(head.mean))

    def solve(self, motion: HeadMotion) -> HeadMotion:
        """The most likely motion near a first guess."""
        return minimise(motion, self.cost, self.linearised, _ITERATIONS)
