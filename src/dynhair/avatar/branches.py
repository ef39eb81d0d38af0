"""A pair of networks of which one hears the expression and one the pose (paper, appendix A)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.mlp import PointMLP


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
        said = [
            _blended(network, points, condition, share, self.bounded)
            for network, condition, share in (
                (self.on_expression, expression, weight),
                (self.on_pose, pose_code, 1 - weight),
            )
        ]
        return said[0] + said[1]


def _blended(network: PointMLP, points: Tensor, condition: Tensor, share: Tensor, bounded: bool) -> Tensor:
    """What a network says, times its share; nought where that is nought, unasked.

    Points whose share is not nought may lie in one piece (the head sorts its Gaussians so): a piece need not be
    gathered, nor its gradients scattered, which took a fifth of the head's time.
    """
    rows = torch.nonzero(share).squeeze(1)
    first, count = (int(rows[0]), len(rows)) if len(rows) else (0, 0)
    if not count or int(rows[-1]) - first + 1 == count:
        value = network(points.narrow(0, first, count), condition)
        value = share.narrow(0, first, count)[:, None] * (value.tanh() if bounded else value)
        return nn.functional.pad(value, (0, 0, first, len(points) - first - count))
    value = network(points.index_select(0, rows), condition)
    value = share[rows, None] * (value.tanh() if bounded else value)
    return points.new_zeros(len(points), value.shape[-1]).index_add(0, rows, value)


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
