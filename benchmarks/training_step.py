"""A step of the joint training, part by part: milliseconds of forward and backward, and memory.

    python benchmarks/training_step.py [--preset tiny|small|medium|paper] [--threads 1] [--steps 12] [--json FILE]

On the bundled capture, with strands that hang straight from its scalp. Where the preset asks for larger images or more
views than the capture has, images are enlarged, views repeated, and cameras with them; the head starts from the tracked
mesh with the preset's number of Gaussians, whatever the preset starts it from.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import resource
import statistics
import time
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import torch
from rich.console import Console
from rich.table import Table
from torch import nn
from torch.nn import functional

from dynhair.avatar import drawing
from dynhair.capture import Capture
from dynhair.config import Config
from dynhair.demo import sample_capture
from dynhair.presets import PRESETS, preset
from dynhair.render import cpu, kernels
from dynhair.threads import keep_large_blocks, large_pieces
from dynhair.training import contact as contact_module
from dynhair.training import objective as objective_module
from dynhair.training.batches import Batch, Batches
from dynhair.training.frames import training_segments
from dynhair.training.joint_optimizer import joint_optimizer
from dynhair.training.joint_training import GRADIENT_NORM
from dynhair.training.objective import JointObjective
from stopwatch import Stopwatch
from untrained import started

WARM_UP = 2
MIB = 2**20
MAPS = ("hair", "body", "orientation", "coherence")
PROJECTION, BLEND, OPTIMIZER, REST = "projection and binning", "blend", "optimizer", "other losses"


@dataclass(frozen=True)
class Part:
    """Medians over the steps, in milliseconds, and MiB."""

    name: str
    forward: float
    backward: float
    kept: float

    @property
    def both(self) -> float:
        return self.forward + self.backward


@dataclass(frozen=True)
class Profile:
    """A step: medians in milliseconds, memory in MiB.

    Attributes:
        step: the whole step, without the batch.
        data: reading and decoding a batch, which in training another thread does meanwhile.
        parts: what the step consists of.
        state: parameters, their gradients and Adam's two moments.
        peak: of the process.
        sizes: what the step is about.
    """

    step: float
    data: float
    parts: list[Part]
    state: dict[str, float]
    peak: float
    sizes: str


def main() -> None:
    """Print a step's profile."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="small", choices=list(PRESETS), help="whose sizes are taken")
    parser.add_argument("--threads", type=int, default=1, help="that a step may use")
    parser.add_argument("--steps", type=int, default=12, help="that are timed")
    parser.add_argument("--json", type=Path, help="file that keeps the figures")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    keep_large_blocks()
    with large_pieces():
        profile = measured(preset(options.preset), options.steps)
    show(profile, f"preset {options.preset}, threads: {options.threads}")
    if options.json is not None:
        options.json.write_text(json.dumps(dataclasses.asdict(profile), indent=1) + "\n", encoding="utf-8")


def measured(config: Config, steps: int) -> Profile:
    """Time steps as training does them."""
    torch.manual_seed(0)
    capture, settings = Capture.open(sample_capture()), config.training
    objective = started(capture, config)
    optimizer = joint_optimizer(objective, settings.rates)
    segments, size = training_segments(capture), settings.image_size
    source = Batches(capture, segments, views=settings.views, image_size=size, seed=0)
    stopwatch, reading, whole = Stopwatch(), [], []
    watch(stopwatch, objective)

    def step(number: int) -> None:
        began = time.perf_counter()
        batch = source.batch(number)
        reading.append(1e3 * (time.perf_counter() - began))
        batch = enlarged(batch, size, settings.views)
        began = time.perf_counter()
        with stopwatch.round():
            with stopwatch.part(REST):
                result = objective(batch, number)
            with stopwatch.part(OPTIMIZER):
                optimizer.zero_grad(set_to_none=True)
            with stopwatch.part(REST, "backward"):
                result.loss.backward()
            with stopwatch.part(OPTIMIZER):
                nn.utils.clip_grad_norm_(objective.avatar.hair.deformer.parameters(), GRADIENT_NORM)
                optimizer.step()
        whole.append(1e3 * (time.perf_counter() - began))

    for number in range(WARM_UP):
        step(number)
    for times in (reading, whole, stopwatch.rounds):
        times.clear()
    for number in range(WARM_UP, WARM_UP + steps):
        step(number)
    medians, step_time, data_time = stopwatch.medians(), statistics.median(whole), statistics.median(reading)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    tensors = [*objective.parameters(), *objective.buffers()]
    with stopwatch.counting_memory(but={tensor.untyped_storage().data_ptr() for tensor in tensors}):
        step(0)
    parts = [
        Part(
            name, medians.get((name, "forward"), 0.0), medians.get((name, "backward"), 0.0), stopwatch.kept[name] / MIB
        )
        for name in dict.fromkeys(name for name, _ in medians)
    ]
    avatar, stored = objective.avatar, max(source.batch(0).rgb.shape[1:3])
    strands, points = avatar.hair.strands.shape[:2]
    sizes = (
        f"{strands} strands of {points} points, {len(avatar.head.means)} Gaussians of the head, {settings.views} views "
        f"of {size} pixels" + ("" if stored == size else f" (read as {source.views} of {stored})")
    )
    return Profile(step_time, data_time, parts, state_size(objective), peak, sizes)


def watch(stopwatch: Stopwatch, objective: JointObjective) -> None:
    """Tell the parts of a step apart."""
    avatar = objective.avatar
    stopwatch.watch(avatar.hair, "forward", "strands")
    stopwatch.watch(avatar.hair.deformer, "forward", "deformer")
    stopwatch.watch(avatar.head, "forward", "head")
    stopwatch.watch(avatar, "draw", "features of the Gaussians")
    stopwatch.watch(drawing, "drawn_hair", "hair as the cameras see it")
    stopwatch.watch(cpu, "rasterize_cpu", BLEND)
    stopwatch.watch(cpu, "list_splats", PROJECTION)
    # the rasterizer's own backward is one function: first the blend's kernel is fetched, then the projection's
    stopwatch.watch_entry(kernels, "blend_backward", BLEND, "backward")
    stopwatch.watch_entry(kernels, "project_backward", PROJECTION, "backward")
    for name, function in list(vars(objective_module).items()):
        if getattr(function, "__module__", "").startswith("dynhair.losses") and name.endswith("_loss"):
            stopwatch.watch(objective_module, name, f"loss: {name.removesuffix('_loss')}")
    stopwatch.watch(objective_module, "agreed_colours", "loss: agreed colours")
    stopwatch.watch(contact_module, "depth_loss", "loss: penetration")  # after the query, which another thread makes


def enlarged(batch: Batch, longer: int, views: int) -> Batch:
    """The batch with images and cameras at another size, if they are smaller, and views again, if they are fewer."""
    again = [place % len(batch.cameras) for place in range(views)]
    height, width = batch.rgb.shape[1:3]
    factor = max(longer / max(height, width), 1)
    size = round(height * factor), round(width * factor)
    planes = torch.cat([batch.rgb.movedim(-1, 1), torch.stack([getattr(batch, name) for name in MAPS], 1)], 1)[again]
    planes = functional.interpolate(planes, size)
    return replace(
        batch,
        cameras=[batch.cameras[place].resized(size[1], size[0]) for place in again],
        rgb=planes[:, :3].movedim(1, -1).contiguous(),
        **{name: planes[:, 3 + k].contiguous() for k, name in enumerate(MAPS)},
    )


def state_size(objective: JointObjective) -> dict[str, float]:
    """MiB of the parameters, their gradients and Adam's two moments."""
    hair, head = objective.avatar.hair, objective.avatar.head
    owners = {
        "hair as the cameras see it": [hair.base_harmonic, hair.higher_harmonics],
        "deformer": list(hair.deformer.parameters()),
        "strands": [hair.strands],
        "head": list(head.parameters()),
    }
    return {name: sum(4 * tensor.nbytes for tensor in tensors) / MIB for name, tensors in owners.items()}


def show(profile: Profile, title: str) -> None:
    """Print the table: by part what it keeps for the backward, and its state with gradients and Adam's moments."""
    table = Table(title=f"{title} (ms, MiB)")
    table.add_column("part", no_wrap=True)
    for column in ("forward", "backward", "share", "kept", "state"):
        table.add_column(column, justify="right")
    for part in sorted(profile.parts, key=lambda part: -part.both):
        state = profile.state.get(part.name)
        table.add_row(
            part.name,
            f"{part.forward:.1f}",
            "" if part.name == OPTIMIZER else f"{part.backward:.1f}",
            f"{part.both / profile.step:.0%}",
            f"{part.kept:.0f}",
            "" if state is None else f"{state:.0f}",
        )
    console = Console()
    console.print(profile.sizes, highlight=False)
    console.print(table)
    console.print(
        f"step {profile.step:.0f} ms, {60_000 / profile.step:.0f} a minute; beside it a batch is read in "
        f"{profile.data:.0f} ms; peak {profile.peak:.0f} MiB",
        highlight=False,
    )


if __name__ == "__main__":
    main()
