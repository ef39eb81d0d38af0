"""A pair of networks against both evaluated everywhere."""

from __future__ import annotations

import torch
from torch import Tensor

from dynhair.avatar.branches import Branches


def blended_everywhere(networks: Branches, points: Tensor, weight: Tensor, expression: Tensor, pose: Tensor) -> Tensor:
    first, second = networks.on_expression(points, expression), networks.on_pose(points, pose)
    return weight[:, None] * first + (1 - weight[:, None]) * second


def test_points_are_looked_for_again_when_weights_change() -> None:
    torch.manual_seed(0)
    networks = Branches(3, 2, 4, (8,), (8,), 5)
    points, expression, pose = torch.randn(30, 3), torch.randn(2), torch.randn(4)
    weight = torch.linspace(0, 1, 30)
    for change in (lambda: None, weight[10:20].zero_, lambda: weight.copy_(weight.flip(0))):
        change()
        for _ in range(2):
            expected = blended_everywhere(networks, points, weight, expression, pose)
            torch.testing.assert_close(networks(points, weight, expression, pose), expected)
    torch.testing.assert_close(
        networks(points, torch.ones(30), expression, pose), networks.on_expression(points, expression)
    )


def test_weights_of_inference_alone_do_not_say_when_they_change() -> None:
    torch.manual_seed(0)
    networks = Branches(3, 2, 4, (8,), (8,), 5)
    with torch.inference_mode():
        points, expression, pose, weight = torch.randn(30, 3), torch.randn(2), torch.randn(4), torch.linspace(0, 1, 30)
        for _ in range(2):
            expected = blended_everywhere(networks, points, weight, expression, pose)
            torch.testing.assert_close(networks(points, weight, expression, pose), expected)
            weight[10:20] = 0
