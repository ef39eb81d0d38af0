"""Learned dynamics of single strands: a network that moves each strand from frame to frame, as a simulator would.

Modes belong to a hairstyle, and have as many motions to learn from as were recorded. How one strand moves under its own
weight, beside head and shoulders, every strand shows in every frame of them: a network that says how a strand speeds up
from how it hangs and moves, and from what pulls at it, has tens of thousands of examples in half a minute. And as it is
of no hairstyle, it can begin from what others have taught it.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import as_file, files
from typing import NamedTuple

import safetensors.torch
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from dynhair.avatar.encoding import encoded_size, positional_encoding
from dynhair.motion import cross_matrix, so3_exp
from dynhair.strands import segment_lengths

POINTS, HIDDEN = 16, 256
"""Of a strand, and width of the network that is taught by simulated hair."""

FPS = 30.0
"""Frames a second of what it is taught by."""

TAUGHT = "strand_dynamics.safetensors"

PLACE, STEP, PULL, OMEGA, ALPHA = 0.05, 0.01, 5.0, 3.0, 30.0
"""Metres, metres a frame, m/s^2, rad/s, rad/s^2: what the network sees as 1."""

FORGOTTEN = 0.01
"""Of a displacement, in each frame."""

REST_UNIT, ROOT_UNIT, ROOT_FREQUENCIES = 0.15, 0.1, 4


class HeadMotions(NamedTuple):
    """Motions of equal length, side by side: all that moves strands. At rest all of it is nothing.

    Attributes:
        omega: angular velocity in the head's frame, rad/s.
        alpha: angular acceleration, likewise, rad/s^2.
        turn: rotation vector of the head since rest, in its frame there.
        weight: gravity less the acceleration of the head frame's origin, in that frame, less what that is at rest,
            m/s^2.
    """

    omega: Float[Tensor, "m f 3"]
    alpha: Float[Tensor, "m f 3"]
    turn: Float[Tensor, "m f 3"]
    weight: Float[Tensor, "m f 3"]


class StrandStates(NamedTuple):
    """Where strands are and how they move.

    Attributes:
        placed: displacements from rest, head frame, metres.
        velocity: metres in the thirtieth of a second that is a frame of what the dynamics are taught by.
    """

    placed: Float[Tensor, "m n k 3"]
    velocity: Float[Tensor, "m n k 3"]


class StrandDynamics(nn.Module):
    """How strands move from frame to frame in the head's frame.

    From frame to frame a velocity keeps a learned share of itself and gains what the network says of the strand: of all
    its points' displacements and velocities; of what pulls at each in the turning head's frame (weight, the
    centrifugal, Euler and Coriolis forces); of where each is on the shoulders against where it rests there; of how the
    strand lies at rest; and of the head's motion. What it says of a resting strand on a resting head is subtracted, so
    that rest is an equilibrium. What it sees is affine in displacement and velocity, so that the rest of its first
    layer is computed for all frames at once.

    A small part of each displacement is forgotten in each frame. Motions that teach are seconds long, and nothing in
    them says that hair which is slightly off must not stay so: without this, errors pile up over a minute.

    No point comes farther from where it rests than twice its way along the strand to the root, which is as far as a
    strand can turn: whatever is learned, hair stays bounded.

    The shoulders do not turn with the head, which turns on them about a point of the neck. That is learned too.

    Args:
        points: of a strand.
        hidden: width.
        neck: where that point is thought to be at first, head frame, metres.
    """

    def __init__(self, points: int, hidden: int, neck: Float[Tensor, "3"]) -> None:
        super().__init__()
        self.neck = nn.Parameter(neck.clone())
        rest = 3 * points + encoded_size(3, ROOT_FREQUENCIES)
        self.of_points = nn.Linear(12 * points, hidden)
        self.of_rest = nn.Linear(rest, hidden, bias=False)
        self.of_head = nn.Linear(9, hidden, bias=False)
        self.middle = nn.Linear(hidden, hidden)
        self.gain = nn.Linear(hidden, 3 * points, bias=False)
        nn.init.normal_(self.gain.weight, std=1e-3)  # the hair rests at first
        self.loss_logit = nn.Parameter(torch.zeros(points, 1))
        self.freedom = nn.Parameter(torch.linspace(0, 1, points)[:, None])

    @classmethod
    def taught(cls) -> StrandDynamics:
        """What simulated hair of other heads has taught (see docs/hair_motion_study.md).

        The neck is counted from the mean of the strands' roots.
        """
        network = cls(POINTS, HIDDEN, torch.zeros(3))
        network.load_state_dict({name: tensor.float() for name, tensor in _taught().items()})
        return network

    def forward(
        self,
        rest: Float[Tensor, "m n k 3"],
        head: HeadMotions,
        start: StrandStates | None = None,
        noise: float = 0.0,
        pace: float = 1.0,
    ) -> Float[Tensor, "m f n k 3"]:
        """Displacements in every frame, metres.

        Args:
            rest: the hair at rest, head frame, metres.
            head: its motion.
            start: of the strands in the first frame; at rest if None.
            noise: standard deviation of what is added to what the network sees of displacements and velocities, anew in
                each frame, in its units: errors of its own that it is taught to live with.
            pace: how long a frame is, in frames of what it is taught by. What is learned of one is scaled to another as
                a semi-implicit step of that length.
        """
        by_state, constant, resting = self._inputs(rest, head)
        placed, velocity = (torch.zeros_like(rest),) * 2 if start is None else start
        placed, velocity = placed.flatten(-2), velocity.flatten(-2)
        kept = torch.sigmoid(-self.loss_logit).expand(-1, 3).flatten() ** pace
        gain = pace * (STEP * self.freedom).expand(-1, 3).reshape(-1, 1) * self.gain.weight
        lasting = _lasting(pace)
        reach = 2 * functional.pad(segment_lengths(rest.flatten(0, 1)).cumsum(-1), (1, 0))
        reach = reach.view(rest.shape[:-1]).repeat_interleave(3, -1)
        units = rest.new_tensor([PLACE, STEP]).repeat_interleave(placed.shape[-1])
        at_rest = functional.linear(self._hidden(resting), gain)
        displacements = [placed]
        # unbound, for the gradient of one frame of a tensor is as large as the tensor
        for weights, given in zip(by_state.unbind(1)[1:], constant.unbind(1)[1:], strict=True):
            state = torch.cat([placed, velocity], -1)
            if noise:
                state = state + noise * units * torch.randn_like(state)
            hidden = self._hidden(torch.baddbmm(given, state, weights))
            before = placed
            faster = kept * velocity + functional.linear(hidden, gain) - at_rest
            placed = (lasting * before + pace * faster).clamp(-reach, reach)
            velocity = velocity_between(before, placed, pace)
            displacements.append(placed)
        return torch.stack(displacements, 1).unflatten(-1, (-1, 3))

    def _hidden(self, first: Float[Tensor, "m n h"]) -> Float[Tensor, "m n h"]:
        """What the last layer sees of a strand, from the sums of the first."""
        return functional.silu(self.middle(functional.silu(first)))

    def _inputs(
        self, rest: Float[Tensor, "m n k 3"], head: HeadMotions
    ) -> tuple[Float[Tensor, "m f s h"], Float[Tensor, "m f n h"], Float[Tensor, "m n h"]]:
        """The first layer: its weights of a strand's displacements, then velocities; the rest of it; that at rest.

        The rest of it is linear in the matrices that turn and pull in a frame. What a strand makes of each of their
        entries is worked out once, and a frame is a sum of these.
        """
        motions, frames, _ = head.omega.shape
        turn = so3_exp(head.turn)
        by_place, by_velocity = inertial_pull(head.omega, head.alpha)
        same = torch.eye(3).to(rest).expand(motions, frames, 3, 3)
        none = torch.zeros_like(same)
        of_place = torch.cat([same / PLACE, none, by_place / PULL, turn / PLACE], -2)
        of_velocity = torch.cat([none, same / STEP, FPS * by_velocity / PULL, none], -2)
        weights = self.of_points.weight.unflatten(-1, (-1, 12))
        by_state = torch.einsum("mfsdc,hkd->mfskch", torch.stack([of_place, of_velocity], 2), weights).flatten(2, 4)

        lies = rest - self.neck
        roots = positional_encoding(lies[:, :, 0] / ROOT_UNIT, ROOT_FREQUENCIES)
        resting = self.of_rest(torch.cat([lies.flatten(-2) / REST_UNIT, roots], -1)) + self.of_points.bias
        of_pull, of_slide = weights[..., 6:9] / PULL, weights[..., 9:] / PLACE
        made = [
            torch.einsum("hkc,mnkd->mcdnh", of_pull, rest).flatten(1, 2),
            torch.einsum("hkc,mnkd->mcdnh", of_slide, lies).flatten(1, 2),
            resting[:, None],
        ]
        turning = [by_place.flatten(-2), (turn - same).flatten(-2), torch.ones_like(head.omega[..., :1])]
        of_strands = torch.cat(turning, -1) @ torch.cat(made, 1).flatten(2)
        moved = torch.cat([head.omega / OMEGA, head.alpha / ALPHA, head.weight / PULL], -1)
        of_head = self.of_head(moved) + functional.linear(head.weight, of_pull.sum(1))
        return by_state, of_strands.unflatten(-1, resting.shape[1:]) + of_head[:, :, None], resting


def inertial_pull(
    omega: Float[Tensor, "*b 3"], alpha: Float[Tensor, "*b 3"]
) -> tuple[Float[Tensor, "*b 3 3"], Float[Tensor, "*b 3 3"]]:
    """Accelerations that a turning frame lends to what is in it.

    Args:
        omega: the frame's angular velocity, in itself, rad/s.
        alpha: its angular acceleration, rad/s^2.

    Returns:
        What takes a place, from the frame's origin, to m/s^2 (centrifugal and Euler), and what takes a velocity in the
        frame there (Coriolis).
    """
    spin = cross_matrix(omega)
    return -cross_matrix(alpha) - spin @ spin, -2 * spin


def velocity_between(before: Tensor, after: Tensor, pace: float = 1.0) -> Tensor:
    """Velocity of strands, as the next frame takes it up, by their displacements in two frames.

    Forgetting slows strands down as well: as much in a second, whatever the pace.
    """
    return (after - _lasting(pace) * before) / pace - pace * FORGOTTEN * before


def _lasting(pace: float) -> float:
    """Share of a displacement that lasts for a frame."""
    return (1 - FORGOTTEN) ** pace


@cache
def _taught() -> dict[str, Tensor]:
    with as_file(files("dynhair.avatar") / TAUGHT) as path:
        return safetensors.torch.load_file(path)
