"""Training, from a capture to an avatar: canonical hair, head, and both together."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from rich.console import Console
from torch import Tensor

from dynhair.avatar import Avatar, Hair, ScalpLayer
from dynhair.avatar.mesh_head import MeshHead
from dynhair.avatar.mlp import quick_precision, use_precision
from dynhair.capture import DEFAULT_CACHE_BYTES, Capture
from dynhair.config import Config
from dynhair.device import best_device
from dynhair.errors import DynhairError
from dynhair.losses import PerceptualDistance
from dynhair.motion import SignalNormalizer, motion_signals
from dynhair.progress import StageProgress
from dynhair.strands import Roots, resample_strands
from dynhair.strands.files import read_strands
from dynhair.threads import keep_large_blocks, large_pieces
from dynhair.training.batches import load_batch
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.frames import head_at_rest, rest_frame, training_cameras, training_segments
from dynhair.training.head_mesh import capture_head_mesh
from dynhair.training.head_on_mesh import start_head_on_mesh
from dynhair.training.head_start import start_head
from dynhair.training.joint_training import JointTraining
from dynhair.training.memory import DYNAMIC_SETTINGS, MESH_SETTINGS, STATIC_SETTINGS, explained_shortage
from dynhair.training.mesh_stage import MeshStage
from dynhair.training.objective import JointObjective
from dynhair.training.processes import Processes
from dynhair.training.recording import capture_recording
from dynhair.training.run import Run, read_hair, write_hair
from dynhair.training.static_hair import StaticStage, strand_width

StageName = Literal["static", "mesh", "dynamic"]
STAGES: tuple[StageName, ...] = ("static", "dynamic")
"""What leads to an avatar; the dynamic stage does the mesh stage first where the head is to begin on its surface."""


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
    as an uninterrupted run on the same machine. Started by torchrun, several processes share the views of each step of
    the dynamic stage, and the result is that of one process but for rounding.

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
        KeyboardInterrupt: Ctrl-C was pressed; what was done is saved.
        DynhairError: the capture does not have what training needs; the groom is not readable; ``out`` is taken, is no
            run to resume, or is to be resumed with another groom; processes cannot share the views evenly; memory or
            disk do not suffice; too many steps had to be skipped, or too many images cannot be read.
    """
    out, groom = Path(out), None if hair_init is None else Path(hair_init)
    processes = Processes()
    data = Capture.open(capture, cache_bytes=DEFAULT_CACHE_BYTES // processes.local_count)
    training_segments(data)  # without any it is refused before there is a run
    if not processes.first:
        console = Console(quiet=True)
    console = console or Console()
    if not resume and processes.first:
        if groom is not None:
            read_strands(groom)  # an unreadable groom is refused before there is a run
        Run.create(out, data.path, with_precision(config or Config()), groom)
    processes.wait()
    run = Run.open(out)
    if resume:
        _require_same(run, data, groom)
    if "dynamic" in stages:  # what cannot be shared out is refused before the hours of the static stage
        settings = run.config.training
        processes.share(min(settings.views, len(training_cameras(data, settings.cameras))))
    keep_large_blocks()
    with large_pieces(), StageProgress(console).shown() as progress:
        training = _Training(run, data, processes, progress, console)
        if "mesh" in stages:
            training.mesh_head()
        if "static" in stages or "dynamic" in stages:
            strands = training.canonical_hair()
            return training.finish(strands) if "dynamic" in stages else None
        return None


def _require_same(run: Run, capture: Capture, groom: Path | None) -> None:
    """Refuse to go on with a run on another capture or from another groom."""
    if run.capture != capture.path.resolve():
        raise DynhairError(
            f"the run was trained on {run.capture}",
            path=run.path,
            expected=str(capture.path),
            mend="name that capture",
        )
    if groom is not None:
        raise DynhairError(
            "a run that goes on keeps the hair that it began with",
            path=run.path,
            expected="no groom",
            mend="leave out --hair-init, or begin another run",
        )


def with_precision(config: Config) -> Config:
    """The configuration with ``auto`` precision decided, so that a resumed run computes as it began."""
    if config.training.precision != "auto":
        return config
    precision = "bfloat16" if quick_precision(best_device()) == torch.bfloat16 else "float32"
    return dataclasses.replace(config, training=dataclasses.replace(config.training, precision=precision))


class _Training:
    """One run's stages, each skipped where the run has its result already."""

    def __init__(
        self, run: Run, capture: Capture, processes: Processes, progress: StageProgress, console: Console
    ) -> None:
        self.run, self.capture, self.processes = run, capture, processes
        self.progress, self.console = progress, console
        self.config = run.config
        self.segments = training_segments(capture)
        self._precision = {"bfloat16": torch.bfloat16}.get(self.config.training.precision)

    def finish(self, strands: Float[Tensor, "n l 3"]) -> Avatar:
        """The dynamic stage, beginning with the canonical hair."""
        with explained_shortage("the joint training", self.config, DYNAMIC_SETTINGS):
            avatar, points, checkpoint = self._start(strands)
            avatar.to(self.processes.device)
            objective = JointObjective(
                avatar,
                self.capture,
                self.segments,
                points,
                self.config.training,
                self._perceptual_distance(),
                self.processes.balance,
            )
            JointTraining(
                objective, self.run, self.capture, self.segments, self.processes, self.progress, self.console
            ).finish(checkpoint)
        avatar = objective.avatar.eval()
        if self.processes.first:
            avatar.save(self.run.avatar)
        self.processes.wait()
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
        width, colour = strand_width(len(strands)), self._hair_colour()
        deformer, dynamic = self.config.hair.deformer, self.config.hair.dynamic
        hair = Hair(strands, width, colour, deformer, dynamic, float(self.capture.fps))
        use_precision(hair, self._precision)
        signals = [motion_signals(self.capture.track(segment)) for segment in self.segments]
        normalizer = SignalNormalizer.fit(signals, deformer, head_at_rest(self.capture))
        background = torch.from_numpy(self.capture.background).float()
        layer = ScalpLayer.under(strands[:, 0], head.means.detach(), started.scalp)
        basis, recording = self.capture.expression_basis, capture_recording(self.capture)
        avatar = Avatar(hair, head, normalizer, background, layer, basis, recording)
        avatar.head_mesh = capture_head_mesh(self.capture)
        return avatar, started.points, checkpoint

    def _perceptual_distance(self) -> PerceptualDistance | None:
        """What images are compared by, if that has a weight; its network is fetched once, by the first process."""
        weights = self.config.training.weights
        if weights.perceptual == 0 and weights.perceptual_raised == 0:
            return None
        distance = PerceptualDistance.pretrained() if self.processes.first else None
        self.processes.wait()
        return (distance or PerceptualDistance.pretrained()).to(self.processes.device)

    def mesh_head(self) -> MeshHead:
        """The mesh stage's head, made by the first process while the others wait."""
        with explained_shortage("the mesh stage", self.config, MESH_SETTINGS):
            stage = MeshStage(self.run, self.capture, self.progress, self.console, self.processes.device)
            head = stage.finish() if self.processes.first else None
            self.processes.wait()
            return head or stage.finish()

    def canonical_hair(self) -> Float[Tensor, "n 200 3"]:
        """The static stage's strands, head frame, metres, made by the first process while the others wait."""
        strands = read_hair(self.run.canonical_hair)
        if strands is None and self.processes.first:
            segment, index = rest_frame(self.capture)
            if self.capture.view(segment.start + index, self.capture.camera_names[0]).orientation is None:
                self.console.print("No orientation maps: strands follow the silhouettes alone.", highlight=False)
            with explained_shortage("the static stage", self.config, STATIC_SETTINGS):
                strands = StaticStage(self.run, self.capture, self.progress, self.console).finish()
            write_hair(strands, self.run.canonical_hair)
        self.processes.wait()
        strands = read_hair(self.run.canonical_hair) if strands is None else strands
        assert strands is not None
        return strands

    def _hair_colour(self) -> Float[Tensor, "3"]:
        """The mean colour of pixels that are all hair, in the rest frame."""
        segment, index = rest_frame(self.capture)
        size = self.config.training.image_size
        batch = load_batch(self.capture, [segment], 0, index, self.capture.camera_names, size)
        inside = batch.hair > 0.9
        return batch.rgb[inside].mean(0) if inside.any() else torch.full((3,), 0.3)
