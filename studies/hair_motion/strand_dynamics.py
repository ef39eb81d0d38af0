"""Dynamics of strands fitted to simulated motions, of one hairstyle or of several."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from studies.hair_motion.recordings import Recorded, mirrored
from torch import Tensor, nn

from dynhair.avatar.strand_dynamics import HeadMotions, StrandDynamics, StrandStates

STEPS, RATE, BATCH = 3000, 2e-3, 6

WEIGHT_DECAY = 1e-2

WINDOW = 25
"""Frames of a step in the first `WINDOWED` of the steps, which begins anywhere, with the true state."""

WINDOWED = 0.7

STRANDS = 64
"""Of a step, drawn anew for each: they are alike in what they teach."""


@dataclass(frozen=True)
class Dynamics:
    """A row of the study: dynamics of single strands.

    Attributes:
        hidden: width of the network's two layers.
        noise: standard deviation of what is added to a strand's state in training, anew in each frame, as a part of
            `PLACE` and `STEP`: what errors of its own it must live with.
        mirror: whether it learns from mirrored motions as well.
        beside: whether half of what it learns from is other hair.
    """

    hidden: int = 256
    noise: float = 0.03
    mirror: bool = True
    beside: bool = False


def head_motions(motions: Sequence[Recorded], frames: slice = slice(None)) -> HeadMotions:
    """Of motions recorded from rest, or of some of their frames."""
    signals = [motion.signals for motion in motions]
    return HeadMotions(
        omega=torch.stack([one.omega for one in signals])[:, frames],
        alpha=torch.stack([one.alpha for one in signals])[:, frames],
        turn=torch.stack([one.rotation for one in signals])[:, frames],
        weight=torch.stack([one.pull - one.pull[0] for one in signals])[:, frames],
    )


def fitted_dynamics(
    row: Dynamics, motions: Sequence[Recorded], steps: int = STEPS, others: Sequence[Recorded] = ()
) -> Callable[[Recorded], Float[Tensor, "f n k 3"]]:
    """Learn dynamics from motions of the same hair.

    Args:
        row: sizes.
        motions: to learn from, one or more.
        steps: of the optimiser.
        others: of other hair, for a row that learns beside it.

    Returns:
        What predicts a motion's displacements from its signals and the hair at rest.
    """
    hair = motions[0].canonical
    network = StrandDynamics(hair.shape[1], row.hidden, neck=hair.mean((0, 1)))
    learned = [*motions] * max(1, round(len(others) / len(motions))) + [*others]
    if row.mirror:
        learned = [*learned, *map(mirrored, learned)]
    fit(network, learned, steps, RATE, row.noise)

    @torch.no_grad()
    def predicted(motion: Recorded) -> Float[Tensor, "f n k 3"]:
        return network(motion.canonical[None], head_motions([motion]))[0]

    return predicted


def fit(
    network: StrandDynamics,
    motions: Sequence[Recorded],
    steps: int,
    rate: float,
    noise: float,
    on_step: Callable[[int], None] = lambda done: None,
) -> None:
    """Optimise dynamics on motions, which may be of different hair.

    The loss is the mean distance from the true points; of short pieces at first, of whole motions from rest at last.

    Args:
        network: what is fitted.
        motions: to learn from, one or more; of a step all are equally long.
        steps: of the optimiser.
        rate: the largest, after a tenth of the steps.
        noise: as of `Dynamics`.
        on_step: told how many steps are done.
    """
    by_length: dict[int, list[Recorded]] = defaultdict(list)
    for motion in motions:
        by_length[len(motion.displacements)].append(motion)
    alike, shares = list(by_length.values()), torch.tensor([float(len(each)) for each in by_length.values()])
    optimizer = torch.optim.AdamW(network.parameters(), rate, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, rate, total_steps=max(1, steps), pct_start=0.1)
    for step in range(steps):
        windowed = step < WINDOWED * steps
        choice = list(motions) if windowed else alike[int(torch.multinomial(shares, 1))]
        batch = [choice[index] for index in torch.randperm(len(choice))[:BATCH].tolist()]
        loss = 100 * _loss(network, batch, noise, windowed)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        on_step(step + 1)


def _loss(network: StrandDynamics, batch: Sequence[Recorded], noise: float, windowed: bool) -> Tensor:
    """Mean distance over one piece of each motion, metres."""
    pieces = [_piece(motion, windowed) for motion in batch]
    strands = torch.randperm(min(len(motion.canonical) for motion in batch))[:STRANDS]
    rest = torch.stack([motion.canonical[strands] for motion in batch])
    true = torch.stack([motion.displacements[piece, strands] for motion, piece in zip(batch, pieces, strict=True)])
    starts = [
        motion.displacements[max(0, piece.start - 1) : piece.start + 1, strands]
        for motion, piece in zip(batch, pieces, strict=True)
    ]
    start = StrandStates(true[:, 0], torch.stack([each[-1] - each[0] for each in starts]))
    parts = [head_motions([motion], piece) for motion, piece in zip(batch, pieces, strict=True)]
    head = HeadMotions(*(torch.cat(values) for values in zip(*parts, strict=True)))
    return (network(rest, head, start, noise) - true).norm(dim=-1).mean()


def _piece(motion: Recorded, windowed: bool) -> slice:
    """Frames of a motion: any `WINDOW` in a row, or all."""
    frames = len(motion.displacements)
    if not windowed or frames <= WINDOW:
        return slice(0, frames)
    first = int(torch.randint(frames - WINDOW + 1, ()))
    return slice(first, first + WINDOW)
