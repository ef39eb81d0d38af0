"""How each Gaussian moves with each expression coefficient: blendshapes of the Gaussians themselves."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn


class ExpressionModes(nn.Module):
    """Displacements linear in the expression, beyond the paper.

    The paper's deformation MLP sees where a Gaussian lies, and an eyelid lies on the eye that it closes over: from
    their places alone it cannot tell what must move from what must stay. Here each Gaussian of the face has a
    displacement of its own for each coefficient, begun with those of the tracked mesh, and the MLP adds what is not
    linear.

    Args:
        rows: indices of the Gaussians that move.
        coefficients: indices of the expression coefficients that move them.
        rest: the rest frame's expression, in which nothing is displaced.
        offsets: displacement for a coefficient's change by 1, head frame, metres.
    """

    rows: Tensor
    coefficients: Tensor
    rest: Tensor

    def __init__(
        self,
        rows: Int[Tensor, " m"],
        coefficients: Int[Tensor, " a"],
        rest: Float[Tensor, " e"],
        offsets: Float[Tensor, "a m 3"],
    ) -> None:
        super().__init__()
        self.register_buffer("rows", rows.clone())
        self.register_buffer("coefficients", coefficients.clone())
        self.register_buffer("rest", rest.clone())
        self.offsets = nn.Parameter(offsets.clone())

    @classmethod
    def blank(cls, expression_size: int, coefficients: int = 0, rows: int = 0) -> ExpressionModes:
        """Modes to be loaded; without any, nothing is displaced."""
        indices = torch.zeros(rows, dtype=torch.long), torch.zeros(coefficients, dtype=torch.long)
        return cls(*indices, torch.zeros(expression_size), torch.zeros(coefficients, rows, 3))

    def displaced(self, points: Float[Tensor, "k 3"], expression: Float[Tensor, " e"]) -> Float[Tensor, "k 3"]:
        """The head's points under an expression, head frame, metres."""
        change = (expression - self.rest)[self.coefficients]
        return points.index_add(0, self.rows, (change @ self.offsets.flatten(1)).unflatten(0, (-1, 3)))


def fitted_modes(
    expressions: Float[Tensor, "f e"],
    rest: Float[Tensor, " e"],
    displacements: Float[Tensor, "f m 3"],
    rows: Int[Tensor, " m"],
    ridge: float,
) -> ExpressionModes:
    """The modes that explain observed displacements, by ridge regression.

    Args:
        expressions: of the observed frames.
        rest: the rest frame's expression.
        displacements: of the points since the rest frame, head frame, metres.
        rows: the points' indices among the head's Gaussians.
        ridge: penalty on the modes, relative to the mean square of the coefficients' changes.
    """
    change = (expressions - rest).double()
    coefficients = torch.nonzero(change.abs().amax(0) > 0).squeeze(1)
    change = change[:, coefficients]
    gram = change.T @ change
    penalty = ridge * gram.diagonal().mean() * torch.eye(len(coefficients), dtype=gram.dtype)
    offsets = torch.linalg.solve(gram + penalty, change.T @ displacements.flatten(1).double())
    return ExpressionModes(rows, coefficients, rest, offsets.unflatten(1, (-1, 3)).float())
