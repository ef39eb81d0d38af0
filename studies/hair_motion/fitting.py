"""The study's rows: deformers and dynamics fitted to the true displacements of guide strands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from studies.hair_motion.motions import FRAMES
from studies.hair_motion.recordings import Recorded, mean_explained, mirrored
from studies.hair_motion.strand_dynamics import STEPS as DYNAMICS_STEPS
from studies.hair_motion.strand_dynamics import Dynamics, fitted_dynamics
from studies.hair_motion.whole_motions import modal_amplitudes, modal_shapes, paper_batch, turned
from torch import Tensor, nn

from dynhair.avatar import ModalDeformer, PaperDeformer
from dynhair.config import DeformerConfig
from dynhair.errors import DynhairError
from dynhair.motion import MotionSignals, SignalNormalizer, motion_window
from dynhair.strands import with_lengths

EVERY = 4
"""Of so many guides one is measured, and deformers are fitted to it: neighbours move alike."""

STEPS = {"paper": 1000, "modal": 400}
RATES = {"paper": 1e-3, "modal": 5e-3}
BATCHES = {"paper": 6, "modal": 4}
"""Frames of a step for the paper's network, whole motions for modes."""

NOISE = 0.03

OMEGA, ALPHA = 3.0, 30.0
"""rad/s and rad/s^2: what signals are divided by that are seen in fixed units."""

TURN_UNIT = 0.1
"""Metres that stand for a turn of one radian, where what a deformer says turns segments."""

MODES = DeformerConfig(kind="modal", history=FRAMES, modes=24, position_frequencies=4, knots=0)
PAPER = DeformerConfig(kind="paper", position_frequencies=6, knots=0)


@dataclass(frozen=True)
class Row:
    """One kind of deformer.

    Attributes:
        config: of dynhair's deformer.
        turns: whether what it says of a point turns the segment that ends there, and displacements follow, in the
            place of displacing the point.
        torso: whether modes are also driven by how the head is turned on the shoulders.
        fixed: whether modes see signals in fixed units, in the place of parts of the largest in training, beyond which
            these are clamped.
        noise: standard deviation of what is added to conditions, anew in each step.
        mirror: whether it learns from mirrored motions as well.
    """

    config: DeformerConfig
    turns: bool = False
    torso: bool = False
    fixed: bool = False
    noise: float = 0.0
    mirror: bool = False


ROWS: dict[str, Row | Dynamics] = {
    "paper T=5": Row(replace(PAPER, history=5)),
    "paper T=20": Row(replace(PAPER, history=20)),
    "paper T=45": Row(replace(PAPER, history=45)),
    "8 modes": Row(replace(MODES, modes=8)),
    "16 modes": Row(replace(MODES, modes=16)),
    "24 modes": Row(MODES),
    "32 modes": Row(replace(MODES, modes=32)),
    "24 modes, inextensible": Row(replace(MODES, inextensible=True)),
    "24 modes, turns": Row(MODES, turns=True),
    "24 modes, fixed units": Row(MODES, fixed=True),
    "24 modes, fixed units, noise": Row(MODES, fixed=True, noise=NOISE),
    "24 modes, fixed units, noise, turns": Row(MODES, turns=True, fixed=True, noise=NOISE),
    "24 modes, fixed units, noise, turns, torso": Row(MODES, turns=True, torso=True, fixed=True, noise=NOISE),
    "24 modes, all and mirrored": Row(MODES, turns=True, torso=True, fixed=True, noise=NOISE, mirror=True),
    "strand dynamics": Dynamics(),
    "strand dynamics, beside other hair": Dynamics(beside=True),
}

Predictor = Callable[[Recorded], Float[Tensor, "f n k 3"]]


def thinned(motion: Recorded, every: int = EVERY) -> Recorded:
    """A motion with some of its strands."""
    return replace(motion, canonical=motion.canonical[::every], displacements=motion.displacements[:, ::every])


def fitted(
    row: Row | Dynamics,
    motions: Sequence[Recorded],
    seed: int = 0,
    steps: int | None = None,
    others: Sequence[Recorded] = (),
) -> Predictor:
    """Fit a deformer, or dynamics of strands, to motions of the same hair.

    The loss is the mean distance from the true points, in which what is explained is measured.

    Args:
        row: which.
        motions: to learn from.
        seed: of weights and batches.
        steps: of the optimiser; by default as many as the study takes.
        others: of other hair, for a row that learns beside it.

    Returns:
        What predicts a motion's displacements from its signals and the hair at rest.

    Raises:
        DynhairError: there are no motions.
    """
    if not motions:
        raise DynhairError("no motion to learn from", expected="one or more")
    torch.manual_seed(seed)
    if isinstance(row, Dynamics):
        return fitted_dynamics(row, motions, DYNAMICS_STEPS if steps is None else steps, others)
    kind = row.config.kind
    learned = [*motions, *(mirrored(motion) for motion in motions)] if row.mirror else list(motions)
    normalizer = SignalNormalizer.fit([motion.signals for motion in learned], row.config)
    network = _Network(row, learned, normalizer)
    steps = STEPS[kind] if steps is None else steps
    optimizer = torch.optim.AdamW(network.parameters(), RATES[kind], weight_decay=1e-3 if kind == "paper" else 0.0)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(steps):
        loss = 100 * network.loss(learned, BATCHES[kind])
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
    return network.predicted


def score(predictor: Predictor, motions: Sequence[Recorded]) -> float:
    """The mean over motions of what a predictor explains."""
    return mean_explained((predictor(motion), motion.displacements) for motion in motions)


class _Network(nn.Module):
    """A deformer of the hair, and of the mirrored hair if it learns from it, whose strands come second."""

    def __init__(self, row: Row, motions: Sequence[Recorded], normalizer: SignalNormalizer) -> None:
        super().__init__()
        self.row, self.normalizer = row, normalizer
        self.canonical = motions[0].canonical
        self.strands = len(self.canonical)
        hair = torch.cat([self.canonical, motions[-1].canonical]) if row.mirror else self.canonical
        self.hair = hair
        self.deformer = (PaperDeformer if row.config.kind == "paper" else ModalDeformer)(hair, row.config)
        if row.torso:
            forces = self.deformer.get_submodule("forces")
            assert isinstance(forces, nn.Linear)
            wider = nn.Linear(forces.in_features + 3, forces.out_features, bias=False)
            nn.init.normal_(wider.weight, std=0.5)
            self.deformer.forces = wider

    def conditions(self, signals: MotionSignals) -> Tensor:
        """Normalised signals, one row a frame."""
        conditions = self.normalizer(signals)
        if self.row.fixed:
            conditions = torch.cat([signals.omega / OMEGA, signals.alpha / ALPHA, conditions[:, 6:]], -1)
        return torch.cat([conditions, signals.rotation], -1) if self.row.torso else conditions

    def loss(self, motions: Sequence[Recorded], batch: int) -> Tensor:
        """The mean distance over a random batch."""
        deformer = self.deformer
        if isinstance(deformer, PaperDeformer):
            frames = [(int(torch.randint(len(motions), ())), int(torch.randint(FRAMES, ()))) for _ in range(batch)]
            history = self.row.config.history
            windows = [motion_window(self.conditions(motions[m].signals), f, history) for m, f in frames]
            found = paper_batch(deformer, torch.stack(windows))
            return (found - torch.stack([motions[m].displacements[f] for m, f in frames])).norm(dim=-1).mean()
        assert isinstance(deformer, ModalDeformer)
        chosen = torch.randperm(len(motions))[:batch].tolist()
        conditions = torch.stack([self.conditions(motions[m].signals) for m in chosen])
        conditions = conditions + self.row.noise * torch.randn_like(conditions)
        amplitudes = modal_amplitudes(deformer, conditions)
        # the mirrored strands are the second half, and so are the mirrored motions
        side = torch.tensor([self.row.mirror and m >= len(motions) // 2 for m in chosen]).long()
        shapes = modal_shapes(deformer).unflatten(0, (-1, self.strands))[side]
        values = torch.einsum("mnlcr,mfr->mfnlc", shapes, amplitudes)
        found = self._displaced(values, self.hair.unflatten(0, (-1, self.strands))[side][:, None])
        return (found - torch.stack([motions[m].displacements for m in chosen])).norm(dim=-1).mean()

    @torch.no_grad()
    def predicted(self, motion: Recorded) -> Float[Tensor, "f n k 3"]:
        """Displacements of the hair in every frame of a motion."""
        conditions, deformer = self.conditions(motion.signals), self.deformer
        if isinstance(deformer, PaperDeformer):
            history = self.row.config.history
            windows = torch.stack([motion_window(conditions, frame, history) for frame in range(len(conditions))])
            return torch.cat([paper_batch(deformer, part) for part in windows.split(25)])
        assert isinstance(deformer, ModalDeformer)
        amplitudes = modal_amplitudes(deformer, conditions[None])[0]
        values = torch.einsum("nlcr,fr->fnlc", modal_shapes(deformer)[: self.strands], amplitudes)
        return self._displaced(values, self.canonical)

    def _displaced(self, values: Tensor, hair: Tensor) -> Tensor:
        if self.row.turns:
            return turned(values / TURN_UNIT, hair)
        if self.row.config.inextensible:
            rest = hair.expand_as(values)
            moved = with_lengths((rest + values).flatten(0, -3), rest.flatten(0, -3))
            return moved.view_as(values) - rest
        return values
