"""The joint training of hair and head: its steps, which of them are taken, and what they leave behind."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
from rich.console import Console
from torch import Tensor

from dynhair.capture import Capture, Segment
from dynhair.errors import DynhairError
from dynhair.progress import Stage, StageProgress
from dynhair.training.batches import Batch, Batches
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.interruption import interruptible
from dynhair.training.joint_optimizer import gradient_norms, joint_optimizer
from dynhair.training.objective import JointObjective, StepResult
from dynhair.training.previews import preview_picture, write_preview
from dynhair.training.processes import Processes
from dynhair.training.run import Run
from dynhair.training.schedule import falling_rate
from dynhair.training.step_guard import IN_A_ROW, StepGuard
from dynhair.training.training_log import TrainingLog

GRADIENT_NORM = 1.0  # of the deformer: a step early in training cannot throw the hair far
SHOWN_EVERY = 10  # steps between two readings of progress and log


class Outcome(NamedTuple):
    """What a step came to, the same in all processes.

    Attributes:
        loss: the weighted sum of the terms.
        terms: each without its weight.
        norms: of the gradient of each parameter group.
        interrupted: whether Ctrl-C was pressed, in whichever process.
    """

    loss: float
    terms: Mapping[str, float]
    norms: Mapping[str, float]
    interrupted: bool

    @property
    def norm(self) -> float:
        """Of the whole gradient."""
        return math.hypot(*self.norms.values())


class JointTraining:
    """The steps of the joint training. Killed at any moment, it goes on from its last checkpoint.

    Args:
        objective: the avatar and what it is compared with.
        run: where its state lies, and its configuration.
        capture: the images.
        segments: of the capture, those to train on.
        processes: that share the steps.
        progress: where progress is shown.
        console: where the rest is said.
    """

    def __init__(
        self,
        objective: JointObjective,
        run: Run,
        capture: Capture,
        segments: Sequence[Segment],
        processes: Processes,
        progress: StageProgress,
        console: Console,
    ) -> None:
        self.objective, self.run, self.processes = objective, run, processes
        self.progress, self.console = progress, console
        self.config = run.config.training
        self.optimizer = joint_optimizer(objective, self.config.rates)
        self.guard = StepGuard(self.config.bad_steps)
        self.batches = Batches(
            capture,
            segments,
            views=self.config.views,
            image_size=self.config.image_size,
            seed=self.config.seed,
            static_every=self.config.static_every,
            cameras=self.config.cameras,
            share=processes.share,
            report=self._set_aside,
        )
        self._rates = [group["lr"] for group in self.optimizer.param_groups]
        self._terms: dict[str, float] = {}
        self._saved: int | None = None

    def finish(self, checkpoint: Checkpoint | None) -> None:
        """Take the steps that are left.

        Args:
            checkpoint: the state to go on from; None to begin.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed; everything is saved.
            DynhairError: too many steps had to be skipped or views cannot be read; a checkpoint cannot be written.
        """
        if checkpoint is not None:
            checkpoint.restore(self.objective, self.optimizer)
            if checkpoint.record:
                self.guard.restore(checkpoint.record)
            self._saved = checkpoint.step
        first, last = self._saved or 0, self.config.iterations
        self.processes.agree(self.objective)
        stage = self.progress.stage("hair and head together", last, first)
        began = time.monotonic()
        folder = self.run.log if self.processes.first else None
        with TrainingLog(folder, first, self._say) as log, interruptible() as interruption:
            for step, read in enumerate(self.batches.from_step(first, last), first):
                factor = falling_rate(step, last)
                for group, rate in zip(self.optimizer.param_groups, self._rates, strict=True):
                    group["lr"] = rate * factor
                # whatever draws numbers without a generator of its own draws the same ones in a resumed run
                torch.manual_seed(self.config.seed * 1_000_003 + step)
                batch = read.to(self.processes.device)
                result = self.objective(batch, step)
                outcome = self._backward(result, interrupted=interruption.requested)
                self._terms |= outcome.terms  # not every step has all of them
                self._advance(outcome, step, batch)
                done = step + 1
                if done % SHOWN_EVERY == 0 or done == last:
                    self._show(outcome, done, (done - first) / (time.monotonic() - began), factor, stage, log)
                if done % self.config.preview_every == 0:
                    self._preview(result, read, done, log)
                if done % self.config.checkpoint_every == 0 or done == last or outcome.interrupted:
                    self._save(done)
                if outcome.interrupted and done != last:
                    self._say(f"Stopped after step {done}; go on with --resume.")
                    raise KeyboardInterrupt

    def _backward(self, result: StepResult, *, interrupted: bool) -> Outcome:
        """The gradient of a step, averaged over the processes, and what must be known about it."""
        self.optimizer.zero_grad(set_to_none=True)
        result.loss.backward()
        values = torch.stack([result.loss.detach(), result.loss.new_tensor(float(interrupted)), *result.terms.values()])
        gradients = [p.grad for group in self.optimizer.param_groups for p in group["params"] if p.grad is not None]
        self.processes.average([values, *gradients])
        norms = gradient_norms(self.optimizer)
        loss, asked, *rest = torch.cat([values, norms]).tolist()  # one wait for the device, not one for each
        names = [group["name"] for group in self.optimizer.param_groups]
        return Outcome(
            loss,
            dict(zip(result.terms, rest, strict=False)),
            dict(zip(names, rest[len(result.terms) :], strict=True)),
            asked > 0,
        )

    def _advance(self, outcome: Outcome, step: int, batch: Batch) -> None:
        """Take the step, if it may be taken."""
        fault = self.guard.judge(outcome.loss, outcome.norm)
        if fault is None:
            parameters: list[Tensor] = list(self.objective.avatar.hair.deformer.parameters())
            if parameters:
                torch.nn.utils.clip_grad_norm_(parameters, GRADIENT_NORM)
            self.optimizer.step()
        elif self.guard.exhausted:
            raise self._diagnosis(fault, outcome, step, batch)

    def _diagnosis(self, fault: str, outcome: Outcome, step: int, batch: Batch) -> DynhairError:
        guard, segment = self.guard, self.batches.segments[batch.segment]
        saved = "there is no checkpoint yet" if self._saved is None else f"the last checkpoint is of step {self._saved}"
        return DynhairError(
            f"{guard.skipped} steps were skipped, the last {guard.in_a_row} in a row; at step {step} {fault}. "
            f"Frame {segment.start + batch.index} (`{segment.name}`), views {', '.join(batch.names)}. "
            f"Terms, without weights: {_ranked(outcome.terms)}. Gradients: {_ranked(outcome.norms)}. "
            f"Skipped steps changed nothing; {saved}",
            path=self.run.checkpoint,
            expected=f"at most {guard.limit} skipped steps, and {min(guard.limit, IN_A_ROW)} in a row",
            mend="look at that frame's images and masks; in the run's config.yaml lower the learning rates "
            "(training.rates) of the groups named, or the weights (training.weights) of the terms named, or set "
            "training.precision to float32; then go on with --resume",
        )

    def _show(self, outcome: Outcome, done: int, speed: float, factor: float, stage: Stage, log: TrainingLog) -> None:
        skipped = f", {self.guard.skipped} skipped" if self.guard.skipped else ""
        stage.update(done, f"loss {outcome.loss:.4f}, {speed:.1f} it/s{skipped}")
        curves = {
            "loss": outcome.loss,
            "iterations per second": speed,
            "learning-rate factor": factor,
            "gradient norm": outcome.norm,
            "skipped steps": float(self.guard.skipped),
        }
        log.curves(curves | {f"terms/{name}": value for name, value in self._terms.items()}, done)

    def _preview(self, result: StepResult, batch: Batch, done: int, log: TrainingLog) -> None:
        if not self.processes.first:
            return
        picture = preview_picture(result.images, batch)
        log.picture("truth above, avatar below", picture, done)
        try:
            write_preview(picture, self.run.preview)
        except OSError as error:
            self._say(f"{self.run.preview}: the preview of step {done} cannot be written ({error}).")

    def _save(self, done: int) -> None:
        if self.processes.first:
            Checkpoint.of(done, self.objective, self.optimizer, self.guard.state()).write(self.run.checkpoint)
        self._saved = done

    def _set_aside(self, error: DynhairError) -> None:
        self._say(f"{error.path}: {error.message}; training goes on with other views.")

    def _say(self, message: str) -> None:
        if self.processes.first:
            self.console.print(message, highlight=False, soft_wrap=True)


def _ranked(values: Mapping[str, float]) -> str:
    """The values that are not finite or, if all are, the three largest."""
    wrong = [name for name, value in values.items() if not math.isfinite(value)]
    if wrong:
        return "not finite " + ", ".join(wrong)
    largest = sorted(values, key=lambda name: -abs(values[name]))[:3]
    return "largest " + ", ".join(f"{name} {values[name]:.3g}" for name in largest)
