"""Each parameter learns, and at one rate."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import nn

from dynhair.avatar import Avatar
from dynhair.avatar.hair import Hair
from dynhair.config import DeformerConfig, LearningRates
from dynhair.training.joint_optimizer import joint_optimizer
from dynhair.training.objective import JointObjective
from tiny_avatars import make_avatar

RATES = LearningRates(**{one.name: float(number) for number, one in enumerate(dataclasses.fields(LearningRates), 1)})


class Objective(JointObjective):
    """What has parameters of an objective."""

    def __init__(self, avatar: Avatar) -> None:
        nn.Module.__init__(self)
        self.avatar = avatar
        self.pose_corrections = nn.ParameterList([torch.zeros(6), torch.zeros(6)])


@pytest.mark.parametrize("super_resolution", [1, 2])
@pytest.mark.parametrize("dynamic", [True, False])
@pytest.mark.parametrize("kind", ["modal", "paper", "strands"])
def test_each_parameter_is_in_one_group(kind: str, dynamic: bool, super_resolution: int) -> None:
    avatar = make_avatar(super_resolution)
    config = DeformerConfig(kind=kind)  # pyright: ignore[reportArgumentType]
    avatar.hair = Hair(avatar.hair.strands.detach(), 0.001, torch.zeros(3), config, dynamic)
    objective = Objective(avatar)
    names = {id(parameter): name for name, parameter in objective.named_parameters()}
    rates = {}
    for group in joint_optimizer(objective, RATES).param_groups:
        for parameter in group["params"]:
            assert names[id(parameter)] not in rates
            rates[names[id(parameter)]] = group["lr"]
    assert set(rates) == set(names.values())
    assert rates["avatar.head.colour.on_pose.layers.0.weight"] == RATES.head_networks
    assert rates["pose_corrections.1"] == RATES.pose_correction
    if dynamic and kind == "strands":
        assert rates["avatar.hair.deformer.dynamics.neck"] == RATES.dynamics
    elif dynamic:
        assert rates["avatar.hair.deformer.root_attenuation"] == RATES.deformer
    if dynamic and kind == "modal":
        assert rates["avatar.hair.deformer.oscillators.damping_logit"] == RATES.modes
