"""The morphable head, reduced to the points of its surface that the detector's landmarks lie on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from dynhair.face import FaceModel
from dynhair.face.anchors import Anchors


@dataclass(frozen=True)
class Person:
    """What does not change in time.

    Attributes:
        scale: metres of the world per metre of the model.
        identity: coefficients of the model, in standard deviations.
        offsets: how far each landmark lies off its anchor on the model, in the model's frame and metres. It is the
            detector's convention, or shape that the model lacks.
    """

    scale: float
    identity: Float[ndarray, " k"]
    offsets: Float[ndarray, "n 3"]


@dataclass(frozen=True)
class AnchoredHead:
    """A linear model of some points on a head, in the model's frame and metres.

    Attributes:
        mean: the points of the average head.
        identity_modes: offsets of one standard deviation each.
        expression_modes: offsets of each facial action at full strength.
    """

    mean: Float[ndarray, "n 3"]
    identity_modes: Float[ndarray, "n 3 k"]
    expression_modes: Float[ndarray, "n 3 e"]

    @classmethod
    def of(cls, model: FaceModel, anchors: Anchors) -> AnchoredHead:
        """The model's points at anchors."""
        corners = model.faces.numpy()[anchors.faces]  # (n, 3)

        def at_anchors(field: Float[ndarray, "*m v 3"]) -> Float[ndarray, "*m n 3"]:
            return np.einsum("nc,...ncd->...nd", anchors.barycentric, field[..., corners, :].astype(np.float64))

        return cls(
            mean=at_anchors(model.mean.numpy()),
            identity_modes=np.moveaxis(at_anchors(model.identity_modes.numpy()), 0, -1),
            expression_modes=np.moveaxis(at_anchors(model.expression_modes.numpy()), 0, -1),
        )

    @classmethod
    def of_vertices(cls, model: FaceModel, vertices: ndarray) -> AnchoredHead:
        """The model's points at some of its vertices."""
        return cls(
            mean=model.mean.numpy()[vertices].astype(np.float64),
            identity_modes=np.moveaxis(model.identity_modes.numpy()[:, vertices].astype(np.float64), 0, -1),
            expression_modes=np.moveaxis(model.expression_modes.numpy()[:, vertices].astype(np.float64), 0, -1),
        )

    def average_person(self) -> Person:
        """The average head at its natural size."""
        return Person(1.0, np.zeros(self.identity_modes.shape[-1]), np.zeros_like(self.mean))

    def points(self, person: Person, expressions: Float[ndarray, "f e"]) -> Float[ndarray, "f n 3"]:
        """The points of a person's head with some expressions, in the head's frame and metres of the world."""
        neutral = self.mean + person.offsets + self.identity_modes @ person.identity
        return person.scale * (neutral + np.einsum("nde,fe->fnd", self.expression_modes, expressions))
