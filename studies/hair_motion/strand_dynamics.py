"""Learned dynamics of single strands: a network that moves each strand from frame to frame, as a simulator would.

Modes belong to a hairstyle, and have as many motions to learn from as were recorded. How one strand moves under its own
weight, beside head and shoulders, every strand shows in every frame of them: a network that says how a strand speeds up
from how it hangs and moves, and from what pulls at it, has tens of thousands of examples in half a minute.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from studies.hair_motion.motions import FPS
from studies.hair_motion.recordings import Recorded, mirrored
from torch import Tensor, nn
from torch.nn import functional

from dynhair.avatar.encoding import encoded_size, positional_encoding
from dynhair.motion import cross_matrix, so3_exp

STEPS, RATE, BATCH = 3000, 2e-3, 6
WEIGHT_DECAY = 1e-2

WINDOW = 25
"""Frames of a step in the first `WINDOWED` of the steps, which begins anywhere, with the true state."""

WINDOWED = 0.7

STRANDS = 64
"""Of a step, drawn anew for each: they are alike in what they teach."""

PLACE, STEP, PULL, OMEGA, ALPHA = 0.05, 0.01, 5.0, 3.0, 30.0
"""Metres, metres a frame, m/s^2, rad/s, rad/s^2: what the network sees as 1."""

REST_UNIT, ROOT_UNIT, ROOT_FREQUENCIES = 0.15, 0.1, 4


@dataclass(frozen=True)
class Dynamics:
    """A row of the study: dynamics of single strands.

    Attributes:
        hidden: width of the network's two layers.
        noise: standard deviation of what is added to a strand's state in training, anew in each frame, as a part of
            `PLACE` and `STEP`: what errors of its own it must live with.
        mirror: whether it learns from mirrored motions as well.
    """

    hidden: int = 256
    noise: float = 0.03
    mirror: bool = True


@dataclass(frozen=True)
class HeadMotions:
    """Motions of equal length, side by side: all that moves strands.

    Attributes:
        omega, alpha, rotation: as of `dynhair.motion.MotionSignals`.
        weight: its ``pull``, less what that is at rest.
    """

    omega: Float[Tensor, "m f 3"]
    alpha: Float[Tensor, "m f 3"]
    rotation: Float[Tensor, "m f 3"]
    weight: Float[Tensor, "m f 3"]

    @classmethod
    def of(cls, motions: Sequence[Recorded], frames: slice = slice(None)) -> HeadMotions:
        """Those of motions recorded from rest, or some of their frames."""
        signals = [motion.signals for motion in motions]
        every = (
            [one.omega for one in signals],
            [one.alpha for one in signals],
            [one.rotation for one in signals],
            [one.pull - one.pull[0] for one in signals],
        )
        return cls(*(torch.stack(values)[:, frames] for values in every))


class StrandDynamics(nn.Module):
    """How strands move from frame to frame in the head's frame.

    From frame to frame a velocity keeps a learned share of itself and gains what the network says of the strand: of all
    its points' displacements and velocities; of what pulls at each in the turning head's frame (weight, the
    centrifugal, Euler and Coriolis forces); of where each is on the shoulders against where it rests there; of how the
    strand lies at rest; and of the head's motion. What it sees is affine in displacement and velocity, so that the
    rest of its first layer is computed for all frames at once.

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
        self.gain = nn.Linear(hidden, 3 * points)
        nn.init.normal_(self.gain.weight, std=1e-3)  # the hair rests at first
        nn.init.zeros_(self.gain.bias)
        self.loss_logit = nn.Parameter(torch.zeros(points, 1))
        self.freedom = nn.Parameter(torch.linspace(0, 1, points)[:, None])

    def forward(
        self,
        canonical: Float[Tensor, "m n k 3"],
        head: HeadMotions,
        start: tuple[Float[Tensor, "m n k 3"], Float[Tensor, "m n k 3"]] | None = None,
        noise: float = 0.0,
    ) -> Float[Tensor, "m f n k 3"]:
        """Displacements in every frame, metres.

        Args:
            canonical: the hair at rest, head frame, metres.
            head: its motion.
            start: displacements, and velocities in metres a frame, in the first frame; at rest if None.
            noise: as of `Dynamics`.
        """
        placed, velocity = (torch.zeros_like(canonical),) * 2 if start is None else start
        linear, constant = self._inputs(canonical, head)
        kept, gain = torch.sigmoid(-self.loss_logit), STEP * self.freedom
        units = canonical.new_tensor([PLACE] * 3 + [STEP] * 3)
        displacements = [placed]
        for frame in range(1, constant.shape[1]):
            state = torch.cat([placed, velocity], -1)
            if noise:
                state = state + noise * units * torch.randn_like(state)
            seen = (state @ linear[:, frame, None]).flatten(-2)
            hidden = functional.silu(functional.linear(seen, self.of_points.weight) + constant[:, frame])
            gained = self.gain(functional.silu(self.middle(hidden))).view_as(velocity)
            velocity = kept * velocity + gain * gained
            placed = placed + velocity
            displacements.append(placed)
        return torch.stack(displacements, 1)

    def _inputs(
        self, canonical: Float[Tensor, "m n k 3"], head: HeadMotions
    ) -> tuple[Float[Tensor, "m f 6 12"], Float[Tensor, "m f n h"]]:
        """What the network sees of a point's displacement and velocity, and the rest of its first layer."""
        motions, frames, _ = head.omega.shape
        turn = so3_exp(head.rotation)
        by_place, by_velocity = inertial_pull(head.omega, head.alpha)
        same = torch.eye(3).to(canonical).expand(motions, frames, 3, 3)
        none = torch.zeros_like(same)
        linear = torch.cat(
            [
                torch.cat([same / PLACE, none, by_place / PULL, turn / PLACE], -2),
                torch.cat([none, same / STEP, FPS * by_velocity / PULL, none], -2),
            ],
            -1,
        ).mT
        pulled = torch.einsum("mfcd,mnkd->mfnkc", by_place, canonical) + head.weight[:, :, None, None]
        slid = torch.einsum("mfcd,mnkd->mfnkc", turn - same, canonical - self.neck)
        still = torch.zeros_like(pulled)
        of_points = self.of_points(torch.cat([still, still, pulled / PULL, slid / PLACE], -1).flatten(-2))
        lies = canonical - self.neck
        roots = positional_encoding(lies[:, :, 0] / ROOT_UNIT, ROOT_FREQUENCIES)
        of_rest = self.of_rest(torch.cat([lies.flatten(-2) / REST_UNIT, roots], -1))
        moved = torch.cat([head.omega / OMEGA, head.alpha / ALPHA, head.weight / PULL], -1)
        return linear, of_points + of_rest[:, None] + self.of_head(moved)[:, :, None]


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


def fitted_dynamics(
    row: Dynamics, motions: Sequence[Recorded], steps: int = STEPS
) -> Callable[[Recorded], Float[Tensor, "f n k 3"]]:
    """Learn dynamics from motions of the same hair.

    The loss is the mean distance from the true points; of short pieces at first, of whole motions from rest at last.

    Args:
        row: sizes.
        motions: to learn from, one or more, of equal length.
        steps: of the optimiser.

    Returns:
        What predicts a motion's displacements from its signals and the hair at rest.
    """
    learned = [*motions, *(mirrored(motion) for motion in motions)] if row.mirror else list(motions)
    hair = motions[0].canonical
    network = StrandDynamics(hair.shape[1], row.hidden, neck=hair.mean((0, 1)))
    optimizer = torch.optim.AdamW(network.parameters(), RATE, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=max(1, steps), pct_start=0.1)
    for step in range(steps):
        batch = [learned[index] for index in torch.randperm(len(learned))[:BATCH].tolist()]
        loss = 100 * _loss(network, batch, row.noise, windowed=step < WINDOWED * steps)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()

    @torch.no_grad()
    def predicted(motion: Recorded) -> Float[Tensor, "f n k 3"]:
        return network(motion.canonical[None], HeadMotions.of([motion]))[0]

    return predicted


def _loss(network: StrandDynamics, batch: Sequence[Recorded], noise: float, windowed: bool) -> Tensor:
    strands = torch.randperm(len(batch[0].canonical))[:STRANDS]
    canonical = torch.stack([motion.canonical[strands] for motion in batch])
    true = torch.stack([motion.displacements[:, strands] for motion in batch])
    first, frames = 0, true.shape[1]
    if windowed and frames > WINDOW:
        first, frames = int(torch.randint(frames - WINDOW + 1, ())), WINDOW
    piece = slice(first, first + frames)
    start = (true[:, first], true[:, first] - true[:, first - 1]) if first else None
    head = HeadMotions.of(batch, piece)
    return (network(canonical, head, start, noise) - true[:, piece]).norm(dim=-1).mean()
