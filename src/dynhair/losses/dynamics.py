"""Hair swings as a damped spring does. The paper has no such term.

Cameras see the outside of the hair, and of a strand's way hardly more than its outline. What they leave open this term
fills with physics: a point x = x_0 + d of unit mass, moved by d from the canonical hair, obeys in the head's frame

    r = d'' + c d' + k_j d - b d_ss - (f(x, d') - p_0) = 0

with f the acceleration of free matter (:class:`dynhair.motion.HeadForces`) and p_0 the pull in the rest frame, which
the canonical hair bears already. Damping c, stiffness k_j of the j-th point and bending b between a strand's points,
with s in [0, 1] along it, are learned from the images with all else. Only the part of r across the strand counts: along
it, tension answers to anything.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.motion import HeadForces
from dynhair.strands import segment_lengths

GRAVITY = 9.81
"""m/s^2: residuals are measured in it."""

KNEE = 0.3
"""Residual, in gravities, from which it counts linearly: hair that slides on a shoulder obeys other forces."""

FIXED = 3
"""Points of a strand that are left out: the scalp holds them."""


class HairSprings(nn.Module):
    """Damping, stiffness and bending of a hairstyle, positive.

    They begin as a pendulum's: a point at arc length l from its root swings as a weight on a thread, k = g / l.

    Args:
        rest: canonical strands, metres.
    """

    def __init__(self, rest: Float[Tensor, "n l 3"]) -> None:
        super().__init__()
        lengths = segment_lengths(rest).cumsum(-1).mean(0)
        lengths = torch.cat([lengths[:1], lengths]).clamp_min(1e-3)
        self.log_stiffness = nn.Parameter((GRAVITY / lengths).log())
        self.log_damping = nn.Parameter(torch.tensor(1.0, device=rest.device))
        self.log_bending = nn.Parameter(torch.tensor(-3.0, device=rest.device))

    def restoring(
        self, displacements: Float[Tensor, "n l 3"], velocities: Float[Tensor, "n l 3"]
    ) -> Float[Tensor, "n l 3"]:
        """What brings displaced points back and slows them down, ``b d_ss - k d - c d'``, m/s^2.

        Args:
            displacements: from the canonical strands, metres; that of a root is what holds it, that of a tip is free.
            velocities: m/s.
        """
        steps = displacements.diff(dim=1) * (displacements.shape[1] - 1)
        curvature = torch.cat([steps, torch.zeros_like(steps[:, :1])], 1).diff(dim=1) * (displacements.shape[1] - 1)
        curvature = torch.cat([torch.zeros_like(curvature[:, :1]), curvature], 1)
        stiffness = self.log_stiffness.exp()[:, None]
        return self.log_bending.exp() * curvature - stiffness * displacements - self.log_damping.exp() * velocities


def dynamics_loss(
    moved: Float[Tensor, "3 n l 3"],
    rest: Float[Tensor, "n l 3"],
    springs: HairSprings,
    forces: HeadForces,
    pull_at_rest: Float[Tensor, "3"],
    fps: float,
) -> Float[Tensor, ""]:
    """Mean over strand points of the Huber norm of ``r / g`` across the strand, with its knee at `KNEE`.

    Args:
        moved: strands in three consecutive frames, head frame, metres.
        rest: the canonical ones.
        springs: what holds them.
        forces: in the frame in the middle.
        pull_at_rest: that the canonical hair bears, m/s^2.
        fps: frames per second.
    """
    before, now, after = moved
    velocity, acceleration = (after - before) * (fps / 2), (after - 2 * now + before) * fps**2
    # The forces are those on the hair where it is; that they change with its place is no reason to move it.
    free = forces.on(now.detach(), velocity) - pull_at_rest
    residual = (acceleration - springs.restoring(now - rest, velocity) - free)[:, FIXED:] / GRAVITY
    tangent = nn.functional.normalize(now.detach().diff(dim=1), dim=-1)[:, FIXED - 1 :]
    across = residual - (residual * tangent).sum(-1, keepdim=True) * tangent
    size = across.norm(dim=-1)
    return torch.where(size < KNEE, size.square() / (2 * KNEE), size - KNEE / 2).mean()
