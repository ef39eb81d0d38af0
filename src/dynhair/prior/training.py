"""Training the encoders: disturbed views of procedural hairstyles in, their strands out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from dynhair.hairstyles import random_head
from dynhair.prior.basis import BasisFit, Form, StrandBasis
from dynhair.prior.dataset import TEXTURE, StyleViews
from dynhair.prior.disturbance import Maps, disturbed, random_views
from dynhair.prior.evidence import Evidence
from dynhair.prior.hair_prior import HairPrior
from dynhair.storage import read_json, write_json
from dynhair.strands import resample_strands, strand_lengths
from dynhair.strands.scalp import smooth_surface
from dynhair.strands.scalp_map import ScalpFrame, directions, texel_uv, texture_roots
from dynhair.training.checkpoint import Checkpoint

COMPONENTS = 64
_NORMAL_POINTS = 200
_LOSS_POINTS = 24
_SHORT = 0.5  # scalp units; below, errors no longer count for more as strands get shorter
_DIRECTIONS = 0.1
_STAGES = (0.3, 0.5, 1.0)  # weights of the coarse strands and of those after each round of the fine network
_BATCH = 4
_LEARNING_RATE = 8e-4
_WARM_UP = 100
_VARIANTS = 4
_LARGEST_GRADIENT = 1.0
_BASIS_TEXELS = 4  # every so many of the texels: neighbours are much alike


@dataclass(frozen=True)
class Target:
    """The strands that the views of a style should yield, of the style itself or of its mirror image.

    Attributes:
        texels: flat indices into the scalp texture.
        strands: at these texels, relative to their roots, scalp units, at equal steps.
    """

    texels: Int[Tensor, " n"]
    strands: Float[Tensor, "n p 3"]

    @classmethod
    def of(cls, style: StyleViews, points: int, *, mirrored: bool = False) -> Target:
        """A style's strands with another number of points."""
        strands, texels = resample_strands(style.strands.float(), points), style.texels
        if mirrored:
            row, column = texels // TEXTURE, texels % TEXTURE
            return cls(row * TEXTURE + TEXTURE - 1 - column, strands * strands.new_tensor([-1, 1, 1]))
        return cls(texels, strands)


def fitted_basis(styles: Sequence[StyleViews], form: Form) -> StrandBasis:
    """The shape basis of the styles' strands and their mirror images; longer strands have a proportional say."""
    fit = BasisFit()
    for style in styles:
        for mirrored in (False, True):
            strands = Target.of(style, _NORMAL_POINTS, mirrored=mirrored).strands[::_BASIS_TEXELS]
            fit.add(strands, _importance(strands) ** 2)
    return fit.fit(COMPONENTS, form)


def mean_hairstyle(styles: Sequence[StyleViews], basis: StrandBasis) -> Float[Tensor, "k s s"]:
    """Mean coefficients of each texel; where no style has a strand, those of the mean strand, which are 0."""
    total, count = torch.zeros(TEXTURE**2, len(basis)), torch.zeros(TEXTURE**2)
    for style in styles:
        for mirrored in (False, True):
            target = Target.of(style, _NORMAL_POINTS, mirrored=mirrored)
            total.index_add_(0, target.texels, basis.encode(target.strands))
            count.index_add_(0, target.texels, torch.ones(len(target.texels)))
    return (total / count.clamp_min(1)[:, None]).T.reshape(-1, TEXTURE, TEXTURE).contiguous()


def mean_roots(styles: Sequence[StyleViews]) -> Float[Tensor, "t 3"]:
    """Mean places of the texels' roots on the styles' heads, scalp units; where no head has scalp, on the sphere."""
    total, count = torch.zeros(TEXTURE**2, 3), torch.zeros(TEXTURE**2, 1)
    for seed in sorted({style.head for style in styles}):
        vertices, faces, scalp = random_head(seed)
        frame = ScalpFrame.of(vertices, faces, scalp)
        roots, texels = texture_roots(vertices, faces, scalp, frame, TEXTURE)
        total[texels] += frame.to_scalp(smooth_surface(roots, vertices, faces)[0])
        count[texels] += 1
    return torch.where(count > 0, total / count.clamp_min(1), directions(texel_uv(TEXTURE)).float())


def strand_loss(strands: Float[Tensor, "n p 3"], truth: Float[Tensor, "n p 3"]) -> Float[Tensor, ""]:
    """Distances of corresponding points, relative to the strands' lengths, and differences of their directions.

    Args:
        strands: relative to their roots, scalp units.
        truth: the same strands as they should be, with equal segments.
    """
    points = ((strands - truth).abs().sum(-1).mean(1) * _importance(truth)).mean()
    segments = truth.diff(dim=1)
    length = segments.norm(dim=-1).clamp_min(1e-4)
    directions = ((strands.diff(dim=1) - segments).norm(dim=-1) / length).clamp_max(2).mean()
    return points + _DIRECTIONS * directions


def decoded(prior: HairPrior, coefficients: Float[Tensor, "k s s"], texels: Int[Tensor, " n"], points: int) -> Tensor:
    """Strands of some texels, relative to their roots, scalp units."""
    return prior.basis.decode(coefficients.flatten(1)[:, texels].T, points)


class PriorTraining:
    """A training that goes on where it was.

    Args:
        prior: untrained.
        styles: to learn from.
        folder: for the checkpoint and the course of the training.
        steps: in total.
        seed: of the draws; each step's depend on the seed and the step alone.
    """

    def __init__(self, prior: HairPrior, styles: Sequence[StyleViews], folder: Path, steps: int, seed: int) -> None:
        self.prior, self.steps, self.course = prior, steps, []
        self._styles, self._seed = styles, seed
        self._gathered: dict[tuple[int, int], Tensor] = {}
        self._optimizer = torch.optim.AdamW(prior.parameters(), lr=_LEARNING_RATE, weight_decay=0.01)
        self._checkpoint, self._course = folder / "checkpoint.safetensors", folder / "course.json"
        self.step = 0
        if self._checkpoint.exists():
            checkpoint = Checkpoint.read(self._checkpoint)
            checkpoint.restore(prior, self._optimizer)
            self.step = checkpoint.step
            self.course: list[dict[str, float | int]] = [
                entry for entry in read_json(self._course)["course"] if entry["step"] <= self.step
            ]

    def run(
        self,
        save_every: int,
        progress: Callable[[int, float], None],
        judge: Callable[[HairPrior], dict[str, float]] = lambda prior: {},
    ) -> None:
        """Train to the end.

        Args:
            save_every: steps between checkpoints.
            progress: called with the step and its loss.
            judge: figures to be noted in the course beside the mean loss whenever a checkpoint is written.
        """
        losses = []
        while self.step < self.steps:
            losses.append(self._take_step())
            progress(self.step, losses[-1])
            if self.step % save_every == 0 or self.step == self.steps:
                self.prior.eval()
                self.course.append({"step": self.step, "loss": float(np.mean(losses))} | judge(self.prior))
                losses = []
                write_json(self._course, {"course": self.course})
                Checkpoint.of(self.step, self.prior, self._optimizer).write(self._checkpoint)

    def _take_step(self) -> float:
        random = np.random.Generator(np.random.PCG64([self._seed, self.step]))
        for group in self._optimizer.param_groups:
            group["lr"] = _LEARNING_RATE * self._schedule()
        evidence, targets = zip(*(self._draw(random) for _ in range(_BATCH)), strict=True)
        self.prior.train()
        stages = self.prior.coarse_to_fine(Evidence.batch(evidence))
        truth = torch.cat([target.strands for target in targets])
        loss = torch.zeros(())
        for weight, textures in zip(_STAGES, stages, strict=True):
            strands = [
                decoded(self.prior, texture, target.texels, _LOSS_POINTS)
                for texture, target in zip(textures, targets, strict=True)
            ]
            loss = loss + weight * strand_loss(torch.cat(strands), truth)
        self._optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.prior.parameters(), _LARGEST_GRADIENT)
        self._optimizer.step()
        self.step += 1
        return float(loss.detach())

    def _schedule(self) -> float:
        """Of the learning rate: up for a few steps, then down along half a cosine."""
        return min(1.0, (self.step + 1) / _WARM_UP) * (0.5 + 0.5 * math.cos(math.pi * self.step / self.steps))

    def _draw(self, random: np.random.Generator) -> tuple[Evidence, Target]:
        index, variant = int(random.integers(len(self._styles))), int(random.integers(_VARIANTS))
        mirrored = bool(random.random() < 0.5)
        evidence = self._evidence(index, variant)
        target = Target.of(self._styles[index], _LOSS_POINTS, mirrored=mirrored)
        return evidence.mirrored() if mirrored else evidence, target

    def _evidence(self, index: int, variant: int) -> Evidence:
        """What is seen of a style in one of a few ways; kept, as to gather it takes as long as to learn from it."""
        key = (index, variant)
        if key not in self._gathered:
            random = np.random.Generator(np.random.PCG64([self._seed, *key]))
            style = self._styles[index]
            maps = disturbed(Maps.of(style, random_views(style, random)), random)
            self._gathered[key] = maps.evidence().volume.half()
        return Evidence(self._gathered[key].float())


def _importance(strands: Tensor) -> Float[Tensor, " n"]:
    """What an error of a strand counts: an error of two centimetres is little for long hair and much for short."""
    return 1 / (_SHORT + strand_lengths(strands))
