"""A pair of networks of which one hears the expression and one the pose (paper, appendix A)."""

from __future__ import annotations

from typing import Any, TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.mlp import PointMLP

Rows: TypeAlias = "slice | Tensor"


class Branches(nn.Module):
    """Two MLPs for the same points, blended point by point; each is evaluated only where its weight is not zero.

    Args:
        point_features: features of a point.
        expression_size: number of expression coefficients.
        pose_size: size of the encoded pose.
        on_expression: hidden layers of the network that hears the expression.
        on_pose: hidden layers of the network that hears the pose.
        outputs: the output's size.
        bounded: whether each network's output passes through tanh.
    """

    def __init__(
        self,
        point_features: int,
        expression_size: int,
        pose_size: int,
        on_expression: tuple[int, ...],
        on_pose: tuple[int, ...],
        outputs: int,
        *,
        bounded: bool = False,
    ) -> None:
        super().__init__()
        self.bounded = bounded
        self._found: tuple[Tensor, int, Rows, Rows] | None = None
        self.on_expression = PointMLP(point_features, expression_size, on_expression, outputs)
        self.on_pose = PointMLP(point_features, pose_size, on_pose, outputs)
        for network in (self.on_expression, self.on_pose):  # both say next to nothing at first
            last = network.layers[-1]
            assert isinstance(last, nn.Linear)
            nn.init.normal_(last.weight, std=1e-3)
            nn.init.zeros_(last.bias)

    def forward(
        self,
        points: Float[Tensor, "k p"],
        weight: Float[Tensor, " k"],
        expression: Float[Tensor, " e"],
        pose_code: Float[Tensor, " q"],
    ) -> Float[Tensor, "k o"]:
        """``weight`` times what the expression says plus ``1 - weight`` times what the pose says.

        Args:
            points: features of the points.
            weight: of the expression, in [0, 1].
            expression: coefficients.
            pose_code: the encoded pose.
        """
        heard = self._heard(weight)
        of_expression, of_pose = _Heard.apply(points, *heard)  # pyright: ignore[reportGeneralTypeIssues]
        values = [self.on_expression(of_expression, expression), self.on_pose(of_pose, pose_code)]
        if self.bounded:
            values = [value.tanh() for value in values]
        return _Blend.apply(weight, *heard, *values)  # pyright: ignore[reportReturnType]

    def _heard(self, weight: Float[Tensor, " k"]) -> tuple[Rows, Rows]:
        """The points of each network, looked for when weights change: the count has to be waited for on a GPU."""
        if weight.is_inference():  # it does not say whether it has changed
            return rows_of(weight), rows_of(1 - weight)
        if self._found is None or self._found[0] is not weight or self._found[1] != weight._version:
            self._found = weight, weight._version, rows_of(weight), rows_of(1 - weight)
        return self._found[2:]


def rows_of(share: Float[Tensor, " k"]) -> Rows:
    """The points whose share is not nought.

    They may lie in one piece (the head sorts its Gaussians so): a piece need not be gathered, nor its gradients
    scattered, which took a fifth of the head's time.
    """
    rows = torch.nonzero(share).squeeze(1)
    if not len(rows):
        return slice(0, 0)
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first + 1 == len(rows) else rows


class _Heard(torch.autograd.Function):
    """The points of each network; their gradients are gathered in one tensor, not in two that are then added."""

    @staticmethod
    def forward(ctx: Any, points: Tensor, on_expression: Rows, on_pose: Rows) -> tuple[Tensor, Tensor]:
        ctx.rows, ctx.count = (on_expression, on_pose), len(points)
        return points[on_expression], points[on_pose]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        on_expression, on_pose = ctx.rows
        whole = gradients[1].new_zeros(ctx.count, gradients[1].shape[1])
        whole[on_pose] = gradients[1]
        if isinstance(on_expression, slice):
            whole[on_expression] += gradients[0]
        else:
            whole.index_add_(0, on_expression, gradients[0])
        return whole, None, None


class _Blend(torch.autograd.Function):
    """The sum of what both networks say of their points, each times its share; the shares get no gradient."""

    @staticmethod
    def forward(
        ctx: Any, weight: Tensor, on_expression: Rows, on_pose: Rows, by_expression: Tensor, by_pose: Tensor
    ) -> Tensor:
        ctx.rows = on_expression, on_pose
        shares = weight[on_expression, None], 1 - weight[on_pose, None]
        ctx.save_for_backward(*shares)
        blended = by_pose.new_zeros(len(weight), by_pose.shape[1])
        blended[on_expression] = by_expression * shares[0]
        if isinstance(on_pose, slice):
            blended[on_pose].addcmul_(by_pose, shares[1])
        else:
            blended.index_add_(0, on_pose, by_pose * shares[1])
        return blended

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        values = [gradients[0][rows] * share for rows, share in zip(ctx.rows, ctx.saved_tensors, strict=True)]
        return None, None, None, *values


def expression_weight(
    points: Float[Tensor, "k 3"], landmarks: Float[Tensor, "m 3"], near: float, far: float
) -> Float[Tensor, " k"]:
    """The expression's share ``clamp((far - d) / (far - near), 0, 1)``, d the distance to the nearest landmark.

    Args:
        points: metres.
        landmarks: metres.
        near: up to this distance the expression alone is heard, metres.
        far: from this distance the pose alone, metres.
    """
    distance = torch.cdist(points, landmarks).amin(1)
    return ((far - distance) / (far - near)).clamp(0, 1)
