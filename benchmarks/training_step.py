"""A step of the joint training: milliseconds, the head's share in it, and memory.

    python benchmarks/training_step.py [--preset small] [--json FILE]

On the bundled capture, with strands that hang straight from its scalp. The head is timed alone: forward, backward with
gradients of the right shapes, and the optimizer's step over its parameters.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import torch

from dynhair.avatar import Avatar, Hair, ScalpLayer, head_pose
from dynhair.capture import Capture
from dynhair.config import preset
from dynhair.demo import sample_capture
from dynhair.motion import SignalNormalizer, motion_signals
from dynhair.strands import sample_roots
from dynhair.threads import keep_large_blocks, large_pieces
from dynhair.training.batches import Batches
from dynhair.training.frames import head_frame, rest_frame, training_segments
from dynhair.training.head_start import start_head
from dynhair.training.objective import JointObjective
from dynhair.training.surface import tracked_surface
from dynhair.training.trainer import joint_optimizer

ROUNDS, REPEATS = 5, 8
HANGING = 0.25  # metres
PARTS = ("means", "scales", "quats", "opacities", "colours")


@dataclass(frozen=True)
class Cost:
    """Medians in milliseconds, their ratio, and the process's peak in MiB."""

    step: float
    head: float
    share: float
    gaussians: int
    peak_memory: float


def main() -> None:
    """Print a step's cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="small", help="whose sizes are taken")
    parser.add_argument("--json", type=Path, help="file that keeps the figures")
    options = parser.parse_args()
    keep_large_blocks()
    with large_pieces():
        cost = measured(options.preset)
    print(
        f"step {cost.step:.0f} ms, of which head {cost.head:.0f} ms ({cost.share:.0%}, {cost.gaussians} Gaussians); "
        f"peak {cost.peak_memory:.0f} MiB"
    )
    if options.json is not None:
        options.json.write_text(json.dumps(asdict(cost), indent=1) + "\n", encoding="utf-8")


def measured(name: str) -> Cost:
    """Time steps and heads in turns, so that a busy machine slows both alike."""
    config = preset(name)
    settings = replace(config.training, precision="float32")
    capture = Capture.open(sample_capture())
    segments = training_segments(capture)
    started = start_head(capture, config.head, 0)
    head = started.head
    strands = hanging_strands(capture, config.hair.strands, config.hair.points)
    hair = Hair(strands, 0.001, torch.full((3,), 0.3), config.hair.deformer)
    normalizer = SignalNormalizer.fit([motion_signals(capture.track(segment)) for segment in segments])
    scalp = ScalpLayer.under(strands[:, 0], head.means.detach(), started.scalp)
    avatar = Avatar(hair, head, normalizer, torch.zeros(3), scalp)
    objective = JointObjective(avatar, capture, segments, started.points, settings)
    optimizer = joint_optimizer(objective, settings.rates)
    source = Batches(capture, segments, views=settings.views, image_size=settings.image_size, seed=0)
    batches = [source.batch(step) for step in range(REPEATS)]
    pose = head_pose(capture.track(segments[0]), 0)
    gradients = [torch.full_like(getattr(head(pose), part), 1e-6) for part in PARTS]
    head_optimizer = torch.optim.Adam(head.parameters(), lr=0.0, fused=True)

    def step(number: int) -> None:
        optimizer.zero_grad(set_to_none=True)
        objective(batches[number], number).loss.backward()
        optimizer.step()

    def head_alone(_: int) -> None:
        head_optimizer.zero_grad(set_to_none=True)
        posed = head(pose)
        torch.autograd.backward([getattr(posed, part) for part in PARTS], gradients)
        head_optimizer.step()

    for work in (step, head_alone):
        median(work)  # warms up
    times = [(median(step), median(head_alone)) for _ in range(ROUNDS)]
    whole, part = (statistics.median(column) for column in zip(*times, strict=True))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Cost(whole, part, part / whole, len(head.means), peak)


def median(work: Callable[[int], None]) -> float:
    """Milliseconds of one call."""
    times = []
    for number in range(REPEATS):
        began = time.perf_counter()
        work(number)
        times.append(1e3 * (time.perf_counter() - began))
    return statistics.median(times)


def hanging_strands(capture: Capture, count: int, points: int) -> torch.Tensor:
    """Strands straight down from the scalp in the rest frame, head frame, metres."""
    surface = tracked_surface(capture)
    segment, index = rest_frame(capture)
    vertices = head_frame(capture.track(segment), index)(surface.vertices(segment.start + index))
    roots = sample_roots(vertices, surface.faces, surface.scalp, count, 0).positions(vertices)
    down = torch.linspace(0, HANGING, points)[:, None] * torch.tensor([0.0, -1.0, 0.0])
    return roots[:, None] + down


if __name__ == "__main__":
    main()
