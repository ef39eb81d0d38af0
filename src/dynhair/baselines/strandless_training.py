"""The steps that train a head without strands, and what they leave behind."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import UInt8
from rich.console import Console

from dynhair.baselines.objective import PhotometricObjective
from dynhair.baselines.start import start_bound_gaussians, start_gaussian_head_avatar
from dynhair.baselines.strandless import StrandlessHead, StrandlessImages
from dynhair.capture import Capture
from dynhair.config import Config
from dynhair.device import best_device
from dynhair.errors import DynhairError
from dynhair.losses import PerceptualDistance
from dynhair.progress import StageProgress
from dynhair.threads import keep_large_blocks, large_pieces
from dynhair.training.batches import Batch, Batches
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.frames import training_segments
from dynhair.training.interruption import interruptible
from dynhair.training.joint_optimizer import gradient_norms
from dynhair.training.memory import DYNAMIC_SETTINGS, explained_shortage
from dynhair.training.previews import write_preview
from dynhair.training.run import Run
from dynhair.training.schedule import falling_rate
from dynhair.training.step_guard import StepGuard
from dynhair.training.training_log import TrainingLog

StrandlessName = Literal["gha", "ga"]

SHOWN_EVERY = 10  # steps between two readings of progress and log


def train_strandless(
    name: StrandlessName,
    capture: Path,
    out: Path,
    config: Config,
    *,
    minutes: float | None = None,
    resume: bool = False,
    console: Console | None = None,
) -> StrandlessHead:
    """Train a head without strands; see :func:`dynhair.baselines.train_baseline`."""
    console, data = console or Console(), Capture.open(capture)
    run = Run.open(out) if resume else Run.create(out, data.path, config)
    if run.capture != data.path.resolve():
        raise DynhairError(
            f"the run was trained on {run.capture}", path=out, expected=str(data.path), mend="name that capture"
        )
    keep_large_blocks()
    start = {"gha": start_gaussian_head_avatar, "ga": start_bound_gaussians}[name]
    with large_pieces(), explained_shortage("the training", run.config, DYNAMIC_SETTINGS):
        head = start(data, run.config).to(best_device())
        training = StrandlessTraining(name, head, run, data, console)
        training.finish(None if minutes is None else 60 * minutes)
    head.eval().save(run.avatar)
    return head


class StrandlessTraining:
    """The steps of one training. Killed at any moment, it goes on from its last checkpoint.

    Args:
        name: of the method.
        head: the model, on its device.
        run: where its state lies, and its configuration.
        capture: the images.
        console: where progress is shown.
    """

    def __init__(
        self, name: StrandlessName, head: StrandlessHead, run: Run, capture: Capture, console: Console
    ) -> None:
        self.name, self.run, self.console = name, run, console
        self.config = config = run.config.training
        segments, weights = training_segments(capture), config.weights
        perceptual = None
        if weights.perceptual or weights.perceptual_raised:
            perceptual = PerceptualDistance.pretrained().to(head.background.device)
        self.objective = PhotometricObjective(head, capture, segments, config, perceptual)
        groups = self.objective.parameter_groups()
        self._rates = [group["lr"] for group in groups]
        self.optimizer = torch.optim.Adam(groups, fused=True)
        self.guard = StepGuard(config.bad_steps)
        self.batches = Batches(
            capture,
            segments,
            views=config.views,
            image_size=config.image_size,
            seed=config.seed,
            static_every=config.static_every,
            cameras=config.cameras,
            report=lambda error: self._say(f"{error.path}: {error.message}; training goes on with other views."),
        )

    def finish(self, seconds: float | None = None) -> None:
        """Take the steps that are left, or as many of them as there is time for.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed; everything is saved.
            DynhairError: the run's checkpoint is of another method; too many steps had to be skipped or views cannot be
                read; a checkpoint cannot be written.
        """
        first, last = self._restored(), self.config.iterations
        began = time.monotonic()
        device = self.objective.head.background.device
        with (
            StageProgress(self.console).shown() as progress,
            TrainingLog(self.run.log, first, self._say) as log,
            interruptible() as interruption,
        ):
            stage = progress.stage(f"training {self.name}", last, first)
            for step, read in enumerate(self.batches.from_step(first, last), first):
                for group, rate in zip(self.optimizer.param_groups, self._rates, strict=True):
                    group["lr"] = rate * falling_rate(step, last)
                batch = read.to(device)
                result = self.objective(batch, step)
                loss, norm = self._step(result.loss, step)
                done, spent = step + 1, time.monotonic() - began
                if done % SHOWN_EVERY == 0 or done == last:
                    speed = (done - first) / spent
                    stage.update(done, f"loss {loss:.4f}, {speed:.1f} it/s")
                    terms = {f"terms/{term}": float(value) for term, value in result.terms.items()}
                    log.curves({"loss": loss, "gradient norm": norm, "iterations per second": speed, **terms}, done)
                if done % self.config.preview_every == 0:
                    self._preview(result.images, read)
                ended = done == last or (seconds is not None and spent > seconds)
                if done % self.config.checkpoint_every == 0 or ended or interruption.requested:
                    record = {**self.guard.state(), "baseline": self.name}
                    Checkpoint.of(done, self.objective, self.optimizer, record).write(self.run.checkpoint)
                if interruption.requested and not ended:
                    self._say(f"Stopped after step {done}; go on with --resume.")
                    raise KeyboardInterrupt
                if ended:
                    break

    def _restored(self) -> int:
        """The steps done before, their state put back."""
        if not self.run.checkpoint.exists():
            return 0
        checkpoint = Checkpoint.read(self.run.checkpoint)
        found = checkpoint.record.get("baseline", "avatar")
        if found != self.name:
            raise DynhairError(f"the run trains '{found}'", path=self.run.path, expected=f"a run of '{self.name}'")
        checkpoint.restore(self.objective, self.optimizer)
        self.guard.restore(checkpoint.record)
        return checkpoint.step

    def _step(self, loss: torch.Tensor, step: int) -> tuple[float, float]:
        """Take a step, if its loss and gradient are sound; their size."""
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        value, *norms = torch.cat([loss.detach()[None], gradient_norms(self.optimizer)]).tolist()
        norm = math.hypot(*norms)
        fault = self.guard.judge(value, norm)
        if fault is None:
            self.optimizer.step()
        elif self.guard.exhausted:
            raise DynhairError(
                f"{self.guard.skipped} steps were skipped, the last {self.guard.in_a_row} in a row; at step {step} "
                f"{fault}",
                path=self.run.checkpoint,
                expected=f"at most {self.guard.limit} skipped steps",
                mend="lower the weights or rates in the run's config.yaml; then go on with --resume",
            )
        return value, norm

    def _preview(self, images: StrandlessImages, batch: Batch) -> None:
        """Write the truth above the head, for each view."""
        rows = [torch.cat(list(rgb), 1) for rgb in (batch.rgb, images.rgb.detach().cpu())]
        picture: UInt8[np.ndarray, "h w 3"] = (torch.cat(rows).clamp(0, 1) * 255 + 0.5).byte().numpy()
        try:
            write_preview(picture, self.run.preview)
        except OSError as error:
            self._say(f"{self.run.preview}: the preview cannot be written ({error}).")

    def _say(self, message: str) -> None:
        self.console.print(message, highlight=False, soft_wrap=True)
