"""The optimizer of the joint training."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.config import LearningRates
from dynhair.training.objective import JointObjective
from dynhair.training.rates import parameter_groups


def joint_optimizer(objective: JointObjective, rates: LearningRates) -> torch.optim.Adam:
    """Adam with a learning rate for each kind of parameter; each group has the ``name`` of its rate.

    Its epsilon is Adam's own: the 1e-15 of Gaussian splatting makes full steps of the faintest gradients, and what no
    camera faces takes on random colours.
    """
    avatar = objective.avatar
    own = {
        **avatar.hair.parameters_by_rate(),
        **avatar.head.parameters_by_rate(),
        "scalp_cover": list(avatar.scalp.parameters()),
        "pose_correction": list(objective.pose_corrections),
        "super_resolution": [] if avatar.super_resolution is None else list(avatar.super_resolution.parameters()),
    }
    own["head_networks"] = own.pop("head_networks")  # last, for checkpoints number parameters in this order
    return torch.optim.Adam(parameter_groups(own, rates), fused=True)


def gradient_norms(optimizer: torch.optim.Optimizer) -> Float[Tensor, " g"]:
    """The Euclidean norm of each parameter group's gradient; zero where there is none."""
    norms = []
    for group in optimizer.param_groups:
        gradients = [parameter.grad for parameter in group["params"] if parameter.grad is not None]
        device = group["params"][0].device
        norms.append(
            torch.nn.utils.get_total_norm(gradients).to(device) if gradients else torch.zeros((), device=device)
        )
    return torch.stack(norms)
