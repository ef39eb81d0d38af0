"""How each Gaussian moves with each expression coefficient: blendshapes of the Gaussians themselves."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from dynhair.avatar.posed_gaussians import ExpressionChange
from dynhair.avatar.rotations import multiply_quaternions, rotation_quaternion


class ExpressionModes(nn.Module):
    """Displacements, turns and growth linear in the expression, beyond the paper.

    The paper's deformation MLP sees where a Gaussian lies, and an eyelid lies on the eye that it closes over: from
    their places alone it cannot tell what must move from what must stay. Here each Gaussian of the face has a
    displacement of its own for each coefficient, begun with those of the tracked mesh, and the MLP adds what is not
    linear. So that a lid that unfolds leaves no gaps, its Gaussians turn and grow with the mesh.

    Args:
        rows: indices of the Gaussians that move.
        coefficients: indices of the expression coefficients that move them.
        rest: the rest frame's expression, in which nothing is changed.
        offsets: displacement for a coefficient's change by 1, head frame, metres; learned.
        turns: rotation vector in the head frame for such a change, radians; fixed.
        growth: change of the log-scale; fixed.
    """

    rows: Tensor
    coefficients: Tensor
    rest: Tensor
    turns: Tensor
    growth: Tensor

    def __init__(
        self,
        rows: Int[Tensor, " m"],
        coefficients: Int[Tensor, " a"],
        rest: Float[Tensor, " e"],
        offsets: Float[Tensor, "a m 3"],
        turns: Float[Tensor, "a m 3"],
        growth: Float[Tensor, "a m"],
    ) -> None:
        super().__init__()
        for name, value in (
            ("rows", rows),
            ("coefficients", coefficients),
            ("rest", rest),
            ("turns", turns),
            ("growth", growth),
        ):
            self.register_buffer(name, value.clone())
        self.offsets = nn.Parameter(offsets.clone())

    @classmethod
    def blank(cls, expression_size: int, coefficients: int = 0, rows: int = 0) -> ExpressionModes:
        """Modes to be loaded; without any, nothing is changed."""
        indices = torch.zeros(rows, dtype=torch.long), torch.zeros(coefficients, dtype=torch.long)
        vectors = torch.zeros(coefficients, rows, 3)
        return cls(*indices, torch.zeros(expression_size), vectors, vectors, vectors[..., 0])

    def displaced(self, points: Float[Tensor, "k 3"], expression: Float[Tensor, " e"]) -> Float[Tensor, "k 3"]:
        """The head's points under an expression, head frame, metres."""
        return points.index_add(0, self.rows, self._sum(self.offsets, expression))

    def turned(self, quats: Float[Tensor, "k 4"], expression: Float[Tensor, " e"]) -> Float[Tensor, "k 4"]:
        """The Gaussians' rotations (wxyz, head frame) under an expression."""
        turns = rotation_quaternion(self._sum(self.turns, expression))
        return quats.index_copy(0, self.rows, multiply_quaternions(turns, quats[self.rows]))

    def grown(self, log_scales: Float[Tensor, "k 3"], expression: Float[Tensor, " e"]) -> Float[Tensor, "k 3"]:
        """The Gaussians' log-scales under an expression; thickness grows with width."""
        growth = self._sum(self.growth[..., None], expression)
        return log_scales.index_add(0, self.rows, growth.expand(-1, 3))

    def change(self, expression: Float[Tensor, " e"], count: int) -> ExpressionChange:
        """All of it at once, for ``count`` Gaussians."""
        slots = torch.full((count,), -1, dtype=torch.int32, device=self.rows.device)
        slots[self.rows] = torch.arange(len(self.rows), dtype=torch.int32, device=self.rows.device)
        return ExpressionChange(
            slots,
            self._sum(self.offsets, expression),
            rotation_quaternion(self._sum(self.turns, expression)),
            self._sum(self.growth[..., None], expression)[:, 0],
        )

    def _sum(self, modes: Float[Tensor, "a m c"], expression: Float[Tensor, " e"]) -> Float[Tensor, "m c"]:
        change = (expression - self.rest)[self.coefficients]
        return (change @ modes.flatten(1)).unflatten(0, modes.shape[1:])


def fitted_modes(
    expressions: Float[Tensor, "f e"],
    rest: Float[Tensor, " e"],
    displacements: Float[Tensor, "f m 3"],
    turns: Float[Tensor, "f m 3"],
    growth: Float[Tensor, "f m"],
    rows: Int[Tensor, " m"],
    ridge: float,
) -> ExpressionModes:
    """The modes that explain observed changes, by ridge regression.

    Args:
        expressions: of the observed frames.
        rest: the rest frame's expression.
        displacements: of the points since the rest frame, head frame, metres.
        turns: rotation vectors of the surface there since the rest frame, head frame, radians.
        growth: change of the logarithm of lengths in the surface.
        rows: the points' indices among the head's Gaussians.
        ridge: penalty on the modes, relative to the mean square of the coefficients' changes.
    """
    change = (expressions - rest).double()
    coefficients = torch.nonzero(change.abs().amax(0) > 0).squeeze(1)
    change = change[:, coefficients]
    gram = change.T @ change
    penalty = ridge * gram.diagonal().mean() * torch.eye(len(coefficients), dtype=gram.dtype)
    observed = torch.cat([displacements, turns, growth[..., None]], -1)
    modes = torch.linalg.solve(gram + penalty, change.T @ observed.flatten(1).double())
    offsets, turns, growth = modes.unflatten(1, (-1, 7)).float().split([3, 3, 1], -1)
    return ExpressionModes(rows, coefficients, rest, offsets, turns, growth[..., 0])
