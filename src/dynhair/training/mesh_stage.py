"""The mesh stage: a mesh head from images, masks and landmarks, for the Gaussian head to begin as (paper, appendix A).

The geometry network first learns the shape of a head like any other, then, with all others, what the training segments
show.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch
from rich.console import Console

from dynhair.avatar import head_pose
from dynhair.avatar.mesh_head import MeshHead
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.mesh import TetrahedralGrid
from dynhair.progress import StageProgress
from dynhair.storage import atomic_file
from dynhair.training.batches import Batches, load_batch
from dynhair.training.checkpoint import Checkpoint
from dynhair.training.frames import rest_frame, training_segments
from dynhair.training.interruption import Interruption, interruptible
from dynhair.training.mesh_objective import MeshObjective
from dynhair.training.mesh_pretraining import first_shape, pretrain
from dynhair.training.mesh_preview import mesh_picture
from dynhair.training.mesh_space import grid_follow, person_box, rest_landmarks
from dynhair.training.previews import write_preview
from dynhair.training.run import Run
from dynhair.training.schedule import falling_rate


class MeshStage:
    """The mesh stage of a run. Killed at any moment, it goes on from its last checkpoint.

    Args:
        run: where its state lies, and its configuration.
        capture: with hair masks and landmarks.
        progress: where progress is shown.
        console: where the rest is said.
        device: where the mesh head is trained; the result is on the CPU.

    Raises:
        DynhairError: the capture has no landmarks of a face, or masks that leave no room for one.
    """

    def __init__(
        self,
        run: Run,
        capture: Capture,
        progress: StageProgress,
        console: Console,
        device: torch.device | str = "cpu",
    ) -> None:
        self.device = torch.device(device)
        self.run, self.capture, self.progress, self.console = run, capture, progress, console
        self.config = run.config.mesh
        self.seed = run.config.training.seed
        self.segments = training_segments(capture)
        self.segment, self.index = rest_frame(capture)
        grid = TetrahedralGrid.of(*person_box(capture), self.config.resolution)
        torch.manual_seed(self.seed)
        self.head = MeshHead(
            grid,
            first_shape(capture, grid),
            grid_follow(capture, grid) if run.config.head.follow_weights else torch.ones(len(grid.vertices)),
            rest_landmarks(capture),
            head_pose(capture.track(self.segment), self.index),
            run.config.head,
            self.config,
        )

    @property
    def checkpoint(self) -> Path:
        """The newest checkpoint."""
        return self.run.path / "mesh_stage.safetensors"

    @property
    def result(self) -> Path:
        """The finished mesh head."""
        return self.run.path / "mesh_head.safetensors"

    @property
    def preview(self) -> Path:
        """The rest frame in every view: image, mesh, and the mesh's normals as colours."""
        return self.run.path / "mesh_head.png"

    def finish(self) -> MeshHead:
        """Do what is left of the stage.

        Returns:
            The mesh head, its surface found in the whole grid.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed; everything is saved.
            DynhairError: the capture has no hair masks; no surface is left; a file of the run is damaged.
        """
        if self.result.exists():
            self._read_result()
            return self.head
        with interruptible() as interruption:
            self._optimise(interruption)
        self.head.cpu().geometry.refresh()
        with atomic_file(self.result) as temporary:
            safetensors.torch.save_file(dict(self.head.state_dict()), temporary)
        self._write_preview()
        return self.head

    def _optimise(self, interruption: Interruption) -> None:
        """Train the mesh head, from the checkpoint if there is one."""
        head, config = self.head.to(self.device), self.config
        optimizer = torch.optim.Adam(self._groups())
        rates = [group["lr"] for group in optimizer.param_groups]
        first = 0
        if self.checkpoint.exists():
            checkpoint = Checkpoint.read(self.checkpoint)
            checkpoint.restore(head, optimizer)
            first = checkpoint.step
        else:
            pretrain(head.geometry, config.pretraining_iterations, self.seed)
            Checkpoint.of(0, head, optimizer).write(self.checkpoint)
        objective = MeshObjective(self.capture, self.segments, config.weights)
        batches = Batches(self.capture, self.segments, views=config.views, image_size=config.image_size, seed=self.seed)
        shown = self.progress.stage("mesh head", config.iterations, first)
        for step, batch in enumerate(batches.from_step(first, config.iterations), first):
            if step % config.refresh_every == 0:
                head.geometry.refresh()
            for group, rate in zip(optimizer.param_groups, rates, strict=True):
                group["lr"] = rate * falling_rate(step, config.iterations)
            result = objective(head, batch.to(self.device))
            optimizer.zero_grad(set_to_none=True)
            result.loss.backward()
            optimizer.step()
            done = step + 1
            shown.update(done, f"loss {float(result.loss.detach()):.4f}")
            finished = done == config.iterations
            if done % config.checkpoint_every == 0 or finished or interruption.requested:
                Checkpoint.of(done, head, optimizer).write(self.checkpoint)
                self._write_preview()
            if interruption.requested and not finished:
                self.console.print(f"Stopped after step {done} of the mesh head; go on with --resume.", highlight=False)
                raise KeyboardInterrupt

    def _groups(self) -> list[dict[str, Any]]:
        head, config = self.head, self.config
        shape = [head.geometry, head.deformation, head.skinning]
        look = [head.appearance, head.colour]
        return [
            {"params": [p for part in shape for p in part.parameters()], "lr": config.network_rate},
            {"params": [p for part in look for p in part.parameters()], "lr": config.appearance_rate},
            {"params": [head.landmarks], "lr": config.landmark_rate},
        ]

    def _read_result(self) -> None:
        try:
            self.head.load_state_dict(safetensors.torch.load_file(self.result))
        except (OSError, RuntimeError, safetensors.SafetensorError) as error:
            raise DynhairError(
                f"not readable ({error})", path=self.result, mend="delete it: the stage will be done again"
            ) from None

    def _write_preview(self) -> None:
        batch = load_batch(
            self.capture, [self.segment], 0, self.index, self.capture.camera_names, self.config.image_size
        )
        device = self.head.landmarks.device
        pose = head_pose(self.capture.track(self.segment), self.index, device)
        background = torch.from_numpy(self.capture.background).float().to(device)
        write_preview(mesh_picture(self.head, pose, batch.to(device), background), self.preview)
