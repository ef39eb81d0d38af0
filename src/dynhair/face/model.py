"""What every face model is, wherever its numbers come from."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

# Captures leave out the outer corners of the mouth, as Gaussian Head Avatar's do.
LEFT_OUT = (48, 54)


@dataclass(frozen=True)
class FaceModel:
    """A linear model of heads and their expressions.

    Metres, y up, face towards +z, person's left at +x, origin near the centre of the head's turning.

    Attributes:
        name: which model it is.
        mean: the average head.
        identity_modes: offsets of one standard deviation each.
        expression_modes: offsets for a coefficient of 1.
        expression_names: what the expression coefficients do.
        expression_range: coefficients beyond it are not natural: 0 to 1 for the strengths of blendshapes, 3 standard
            deviations to both sides for principal components.
        expression_deviation: standard deviation of the expression coefficients around nought.
        faces: triangles, counter-clockwise seen from outside.
        scalp: indices of the faces that grow hair.
        head_weight: skinning weight of the head's bone: 1 moves with the head, 0 stays with the shoulders.
        landmarks68: vertex indices of the iBUG-68 landmarks.
    """

    name: str
    mean: Float[Tensor, "v 3"]
    identity_modes: Float[Tensor, "k v 3"]
    expression_modes: Float[Tensor, "e v 3"]
    expression_names: tuple[str, ...]
    expression_range: tuple[float, float]
    expression_deviation: float
    faces: Int64[Tensor, "f 3"]
    scalp: Int64[Tensor, " s"]
    head_weight: Float[Tensor, " v"]
    landmarks68: Int64[Tensor, " 68"]

    @property
    def landmarks66(self) -> Int64[Tensor, " 66"]:
        """Vertex indices of the landmarks that captures hold: iBUG-68 without 48 and 54."""
        kept = torch.ones(68, dtype=torch.bool)
        kept[list(LEFT_OUT)] = False
        return self.landmarks68[kept]

    def vertices(
        self, identity: Float[Tensor, " k"] | None = None, expression: Float[Tensor, " e"] | None = None
    ) -> Float[Tensor, "v 3"]:
        """The head of one person with one expression; differentiable.

        Args:
            identity: coefficients in standard deviations; the average head by default.
            expression: coefficients of the expression modes; neutral by default.
        """
        vertices = self.mean
        if identity is not None:
            vertices = vertices + torch.tensordot(identity, self.identity_modes, dims=1)
        if expression is not None:
            vertices = vertices + torch.tensordot(expression, self.expression_modes, dims=1)
        return vertices
