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


class RestingStrands(NamedTuple):
    """What dynamics know of strands before they move.

    Attributes:
        first: the first layer's sums by each entry of the matrices that pull and that slide, and of the strand at rest.
        gained: what the network says of the strand at rest, which is subtracted.
        reach: how far each coordinate of each point may come from rest, metres.
    """

    first: Float[Tensor, "m e n h"]
    gained: Float[Tensor, "m n c"]
    reach: Float[Tensor, "m n c"]


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
        return self.moved(self.resting(rest), head, start, noise, pace)

    def resting(self, rest: Float[Tensor, "m n k 3"]) -> RestingStrands:
        """What there is to know of strands before they move.

        The first layer is linear in the matrices by which a frame turns and pulls: what a strand makes of each of their
        entries is worked out once, and a frame is a sum of these.
        """
        lies = rest - self.neck
        roots = positional_encoding(lies[:, :, 0] / ROOT_UNIT, ROOT_FREQUENCIES)
        first = self.of_rest(torch.cat([lies.flatten(-2) / REST_UNIT, roots], -1)) + self.of_points.bias
        of_pull, of_slide = self._weights[..., 6:9] / PULL, self._weights[..., 9:] / PLACE
        pulled = torch.einsum("hkc,mnkd->mcdnh", of_pull, rest).flatten(1, 2)
        slid = torch.einsum("hkc,mnkd->mcdnh", of_slide, lies).flatten(1, 2)
        reach = 2 * functional.pad(segment_lengths(rest.flatten(0, 1)).cumsum(-1), (1, 0))
        return RestingStrands(
            first=torch.cat([pulled, slid, first[:, None]], 1),
            gained=self.gain(self._hidden(first)),
            reach=reach.view(rest.shape[:-1]).repeat_interleave(3, -1),
        )

    def moved(
        self,
        strands: RestingStrands,
        head: HeadMotions,
        start: StrandStates | None = None,
        noise: float = 0.0,
        pace: float = 1.0,
    ) -> Float[Tensor, "m f n k 3"]:
        """As :meth:`forward`, of strands of which that much is known."""
        by_state, constant = self._inputs(strands, head)
        none = torch.zeros_like(strands.reach)
        placed, velocity = (none, none) if start is None else (start.placed.flatten(-2), start.velocity.flatten(-2))
        kept = torch.sigmoid(-self.loss_logit).expand(-1, 3).flatten() ** pace
        scale = pace * (STEP * self.freedom).expand(-1, 3).flatten()
        lasting = _lasting(pace)
        units = none.new_tensor([PLACE, STEP]).repeat_interleave(none.shape[-1])
        displacements = [placed]
        # unbound, for the gradient of one frame of a tensor is as large as the tensor
        for weights, given in zip(by_state.unbind(1)[1:], constant.unbind(1)[1:], strict=True):
            state = torch.cat([placed, velocity], -1)
            if noise:
                state = state + noise * units * torch.randn_like(state)
            hidden = self._hidden(torch.baddbmm(given, state, weights))
            before = placed
            faster = kept * velocity + scale * (self.gain(hidden) - strands.gained)
            placed = (lasting * before + pace * faster).clamp(-strands.reach, strands.reach)
            velocity = velocity_between(before, placed, pace)
            displacements.append(placed)
        return torch.stack(displacements, 1).unflatten(-1, (-1, 3))

    @property
    def _weights(self) -> Float[Tensor, "h k 12"]:
        """Of the first layer, point by point: of displacement, velocity, pull, and place on the shoulders."""
        return self.of_points.weight.unflatten(-1, (-1, 12))

    def _hidden(self, first: Float[Tensor, "m n h"]) -> Float[Tensor, "m n h"]:
        """What the last layer sees of a strand, from the sums of the first."""
        return functional.silu(self.middle(functional.silu(first)))

    def _inputs(
        self, strands: RestingStrands, head: HeadMotions
    ) -> tuple[Float[Tensor, "m f s h"], Float[Tensor, "m f n h"]]:
        """The first layer: its weights of a strand's displacements, then velocities; and the rest of it."""
        motions, frames, _ = head.omega.shape
        turn = so3_exp(head.turn)
        by_place, by_velocity = inertial_pull(head.omega, head.alpha)
        same = torch.eye(3).to(turn).expand(motions, frames, 3, 3)
        none = torch.zeros_like(same)
        of_place = torch.cat([same / PLACE, none, by_place / PULL, turn / PLACE], -2)
        of_velocity = torch.cat([none, same / STEP, FPS * by_velocity / PULL, none], -2)
        of_state = torch.stack([of_place, of_velocity], 2)
        by_state = torch.einsum("mfsdc,hkd->mfskch", of_state, self._weights).flatten(2, 4)
        turning = [by_place.flatten(-2), (turn - same).flatten(-2), torch.ones_like(head.omega[..., :1])]
        of_strands = (torch.cat(turning, -1) @ strands.first.flatten(2)).unflatten(-1, strands.first.shape[2:])
        moved = torch.cat([head.omega / OMEGA, head.alpha / ALPHA, head.weight / PULL], -1)
        of_head = self.of_head(moved) + functional.linear(head.weight / PULL, self._weights[..., 6:9].sum(1))
        return by_state, of_strands + of_head[:, :, None]


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


def velocity_between(before: Float[Tensor, "*s"], after: Float[Tensor, "*s"], pace: float = 1.0) -> Float[Tensor, "*s"]:
    """Velocity of strands as in `StrandStates`, by their displacements in two frames, metres.

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
