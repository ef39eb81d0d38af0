"""Training, from a capture to an avatar: canonical hair, head, and both together."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from rich.console import Console
from torch import Tensor
from torch.utils.tensorboard.writer import SummaryWriter

from dynhair.avatar import Avatar, Hair, ScalpLayer
from dynhair.avatar.mesh_head import MeshHead
from dynhair.avatar.mlp import quick_precision, use_precision
from dynhair.capture import Capture
from dynhair.config import Config, LearningRates
from dynhair.errors import DynhairError
from dynhair.motion import SignalNormalizer, motion_signals
from dynhair.progress import StageProgress
from dynhair.strands import Roots, resample_strands
from dynhair.strands.files import read_strands
from dynhair.threads import keep_large_blocks, large_pieces
from dynhair.training.batches import Batches, load_batch
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.frames import rest_frame, training_segments
from dynhair.training.head_on_mesh import start_head_on_mesh
from dynhair.training.head_start import start_head
from dynhair.training.interruption import interruptible
from dynhair.training.mesh_stage import MeshStage
from dynhair.training.objective import JointObjective
from dynhair.training.previews import preview_picture, write_preview
from dynhair.training.run import Run, read_hair, write_hair
from dynhair.training.schedule import falling_rate
from dynhair.training.static_hair import StaticStage, strand_width

StageName = Literal["static", "mesh", "dynamic"]
STAGES: tuple[StageName, ...] = ("static", "dynamic")
"""What leads to an avatar; the dynamic stage does the mesh stage first where the head is to begin on its surface."""

GRADIENT_NORM = 1.0  # of the deformer: a step early in training cannot throw the hair far


def train(
    capture: Path | str,
    out: Path | str,
    config: Config | None = None,
    *,
    stages: Sequence[StageName] = STAGES,
    hair_init: Path | str | None = None,
    resume: bool = False,
    console: Console | None = None,
) -> Avatar | None:
    """Train an avatar on a capture.

    Every state of the run lies in ``out``: after a kill at any moment, ``resume`` goes on and ends with the same avatar
    as an uninterrupted run on the same machine.

    Args:
        capture: the capture's folder; training reads its training segments alone, and never its ground truth.
        out: the run's folder; the avatar is written to its ``avatar``.
        config: sizes, iterations, weights; preset ``small`` by default. A resumed run keeps its own.
        stages: ``static`` makes the canonical hair, ``mesh`` the mesh head, ``dynamic`` the avatar from the hair (which
            it makes where the run has none) and, if ``config.head.start`` says so, from the mesh head. After any of
            them the run can be gone on with.
        hair_init: a groom to start the canonical hair from, in any of the formats of :mod:`dynhair.strands.files`, in
            the place of the strand prior's guess.
        resume: go on with the run in ``out``.
        console: where progress is shown.

    Returns:
        The trained avatar; None if the dynamic stage is not asked for.

    Raises:
        DynhairError: the capture does not have what training needs; the groom is not readable; ``out`` is taken, is no
            run to resume, or is to be resumed with another groom.
    """
    out, console = Path(out), console or Console()
    data = Capture.open(capture)
    if resume:
        run = Run.open(out)
        if run.capture != data.path.resolve():
            raise DynhairError(
                f"the run was trained on {run.capture}", path=out, expected=str(data.path), mend="name that capture"
            )
        if hair_init is not None:
            raise DynhairError(
                "a run that goes on keeps the hair that it began with",
                path=out,
                expected="no groom",
                mend="leave out --hair-init, or begin another run",
            )
    else:
        if hair_init is not None:
            read_strands(Path(hair_init))  # an unreadable groom is refused before there is a run
        run = Run.create(
            out, data.path, _with_precision(config or Config()), None if hair_init is None else Path(hair_init)
        )
    keep_large_blocks()
    with large_pieces(), StageProgress(console).shown() as progress:
        training = _Training(run, data, progress, console)
        if "mesh" in stages:
            training.mesh_head()
        if "static" in stages or "dynamic" in stages:
            strands = training.canonical_hair()
            return training.finish(strands) if "dynamic" in stages else None
        return None


def _with_precision(config: Config) -> Config:
    """The configuration with ``auto`` precision decided, so that a resumed run computes as it began."""
    if config.training.precision != "auto":
        return config
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    precision = "bfloat16" if quick_precision(device) == torch.bfloat16 else "float32"
    return dataclasses.replace(config, training=dataclasses.replace(config.training, precision=precision))


class _Training:
    """One run's stages, each skipped where the run has its result already."""

    def __init__(self, run: Run, capture: Capture, progress: StageProgress, console: Console) -> None:
        self.run, self.capture, self.progress, self.console = run, capture, progress, console
        self.config = run.config
        self.segments = training_segments(capture)
        self.fabric = Fabric(accelerator="auto", devices=1)
        self._precision = {"bfloat16": torch.bfloat16}.get(self.config.training.precision)

    def finish(self, strands: Float[Tensor, "n l 3"]) -> Avatar:
        """The dynamic stage, beginning with the canonical hair."""
        avatar, points, checkpoint = self._start(strands)
        avatar.to(self.fabric.device)
        objective = JointObjective(avatar, self.capture, self.segments, points, self.config.training)
        self._train_jointly(objective, checkpoint)
        avatar = objective.avatar.eval()
        avatar.save(self.run.avatar)
        return avatar

    def _start(self, strands: Tensor) -> tuple[Avatar, Roots | None, Checkpoint | None]:
        """The avatar before the joint training, or as the checkpoint left it."""
        seed = self.config.training.seed
        if self.config.head.start == "mesh":
            started = start_head_on_mesh(self.mesh_head(), self.capture, self.config.head, seed)
        else:
            started = start_head(self.capture, self.config.head, seed)
        head = started.head
        use_precision(head, self._precision)
        checkpoint = Checkpoint.read(self.run.checkpoint) if self.run.checkpoint.exists() else None
        torch.manual_seed(seed + 1)
        strands = resample_strands(strands, self.config.hair.points)
        deformer = self.config.hair.deformer
        hair = Hair(strands, strand_width(len(strands)), self._hair_colour(), deformer, self.config.hair.dynamic)
        use_precision(hair, self._precision)
        normalizer = SignalNormalizer.fit([motion_signals(self.capture.track(s)) for s in self.segments], deformer)
        background = torch.from_numpy(self.capture.background).float()
        layer = ScalpLayer.under(strands[:, 0], head.means.detach(), started.scalp)
        basis = self.capture.expression_basis
        return Avatar(hair, head, normalizer, background, layer, basis), started.points, checkpoint

    def mesh_head(self) -> MeshHead:
        """The mesh stage's head."""
        return MeshStage(self.run, self.capture, self.progress, self.console, self.fabric.device).finish()

    def canonical_hair(self) -> Float[Tensor, "n 200 3"]:
        """The static stage's strands, head frame, metres."""
        strands = read_hair(self.run.canonical_hair)
        if strands is None:
            segment, index = rest_frame(self.capture)
            if self.capture.view(segment.start + index, self.capture.camera_names[0]).orientation is None:
                self.console.print("No orientation maps: strands follow the silhouettes alone.", highlight=False)
            strands = StaticStage(self.run, self.capture, self.progress, self.console).finish()
            write_hair(strands, self.run.canonical_hair)
        return strands

    def _hair_colour(self) -> Float[Tensor, "3"]:
        """The mean colour of pixels that are all hair, in the rest frame."""
        segment, index = rest_frame(self.capture)
        size = self.config.training.image_size
        batch = load_batch(self.capture, [segment], 0, index, self.capture.camera_names, size)
        inside = batch.hair > 0.9
        return batch.rgb[inside].mean(0) if inside.any() else torch.full((3,), 0.3)

    def _train_jointly(self, objective: JointObjective, checkpoint: Checkpoint | None) -> None:
        settings = self.config.training
        optimizer = joint_optimizer(objective, settings.rates)
        first = 0
        if checkpoint is not None:
            checkpoint.restore(objective, optimizer)
            first = checkpoint.step
        rates = [group["lr"] for group in optimizer.param_groups]
        model, fabric_optimizer = self.fabric.setup(objective, optimizer)
        batches = Batches(
            self.capture,
            self.segments,
            views=settings.views,
            image_size=settings.image_size,
            seed=settings.seed,
            static_every=settings.static_every,
        )
        stage = self.progress.stage("hair and head together", settings.iterations, first)
        began = time.monotonic()
        with SummaryWriter(self.run.log, purge_step=first) as log, interruptible() as interruption:
            for step, batch in enumerate(batches.from_step(first, settings.iterations), first):
                for group, rate in zip(optimizer.param_groups, rates, strict=True):
                    group["lr"] = rate * falling_rate(step, settings.iterations)
                result = model(batch.to(self.fabric.device), step)
                fabric_optimizer.zero_grad(set_to_none=True)
                self.fabric.backward(result.loss)
                torch.nn.utils.clip_grad_norm_(objective.avatar.hair.deformer.parameters(), GRADIENT_NORM)
                fabric_optimizer.step()
                done = step + 1
                if done % 10 == 0 or done == settings.iterations:
                    loss, speed = float(result.loss.detach()), (done - first) / (time.monotonic() - began)
                    stage.update(done, f"loss {loss:.4f}, {speed:.1f} it/s")
                    log.add_scalar("loss", loss, done)
                    log.add_scalar("iterations per second", speed, done)
                    for name, term in result.terms.items():
                        log.add_scalar(f"terms/{name}", float(term), done)
                if done % settings.preview_every == 0:
                    picture = preview_picture(result.images, batch)
                    log.add_image("truth above, avatar below", picture, done, dataformats="HWC")
                    write_preview(picture, self.run.preview)
                finished = done == settings.iterations
                if done % settings.checkpoint_every == 0 or finished or interruption.requested:
                    Checkpoint.of(done, objective, optimizer).write(self.run.checkpoint)
                if interruption.requested and not finished:
                    self.console.print(f"Stopped after step {done}; go on with --resume.", highlight=False)
                    raise KeyboardInterrupt


def joint_optimizer(objective: JointObjective, rates: LearningRates) -> torch.optim.Adam:
    """Adam with a learning rate for each kind of parameter.

    Its epsilon is Adam's own: the 1e-15 of Gaussian splatting makes full steps of the faintest gradients, and what no
    camera faces takes on random colours.
    """
    avatar = objective.avatar
    hair, head = avatar.hair, avatar.head
    own = {
        "strands": [hair.strands],
        "hair_colour": [hair.base_harmonic],
        "hair_gloss": [hair.higher_harmonics],
        "deformer": list(hair.deformer.parameters()),
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
    own["head_networks"] = [parameter for parameter in objective.parameters() if id(parameter) not in taken]
    groups = [{"params": parameters, "lr": getattr(rates, name)} for name, parameters in own.items() if parameters]
    return torch.optim.Adam(groups, fused=True)
