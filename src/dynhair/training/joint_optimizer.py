"""The optimizer of the joint training."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar import ModalDeformer
from dynhair.config import LearningRates
from dynhair.training.objective import JointObjective


def joint_optimizer(objective: JointObjective, rates: LearningRates) -> torch.optim.Adam:
    """Adam with a learning rate for each kind of parameter; each group has the ``name`` of its rate.

    Its epsilon is Adam's own: the 1e-15 of Gaussian splatting makes full steps of the faintest gradients, and what no
    camera faces takes on random colours.
    """
    avatar = objective.avatar
    hair, head = avatar.hair, avatar.head
    modes = hair.deformer.oscillators if isinstance(hair.deformer, ModalDeformer) else None
    own = {
        "strands": [hair.strands],
        "hair_colour": [hair.base_harmonic],
        "hair_gloss": [hair.higher_harmonics],
        "modes": list(modes.parameters()) if modes is not None else [],
        "deformer": [p for name, p in hair.deformer.named_parameters() if not name.startswith("oscillators.")],
        "head_means": [head.means],
        "head_modes": list(head.modes.parameters()),
        "head_features": [head.features],
        "head_scales": [head.log_scales],
        "head_rotations": [head.quats],
        "head_opacity": [head.opacity_logits],
        "head_colour": [head.base_colours],
        "head_follow": [] if head.follow_logits is None else [head.follow_logits],
        "body_response": list(head.skinning.parameters()),
        "scalp_cover": list(avatar.scalp.parameters()),
        "pose_correction": list(objective.pose_corrections),
        "super_resolution": [] if avatar.super_resolution is None else list(avatar.super_resolution.parameters()),
    }
    taken = {id(parameter) for parameters in own.values() for parameter in parameters}
    own["head_networks"] = [
        parameter for parameter in objective.parameters() if parameter.requires_grad and id(parameter) not in taken
    ]
    groups = [
        {"params": parameters, "lr": getattr(rates, name), "name": name}
        for name, parameters in own.items()
        if parameters
    ]
    return torch.optim.Adam(groups, fused=True)


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
