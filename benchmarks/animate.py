"""Frames a second of an avatar that is driven, part by part: as it is trained, and frozen for drawing alone.

    python benchmarks/animate.py [--preset small] [--size 256] [--threads 1] [--frames 30] [--avatar RUN] [--json FILE]

Without ``--avatar``, on one of the preset's sizes with random weights, on the bundled capture's head. Head and
expression move in every frame; expressions that are held cost a frozen avatar less. Frames of both avatars are posed
and drawn in turns, and the ratio is that of the processors' work, so that it is fair on a busy machine.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import statistics
import time
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from dynhair.animation.procedural import motion
from dynhair.avatar import Avatar, Recording, drawing
from dynhair.avatar.hair import HairDeformer
from dynhair.avatar.mlp import use_precision
from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack
from dynhair.demo import sample_capture
from dynhair.presets import PRESETS, preset
from dynhair.render import cpu
from dynhair.threads import keep_large_blocks, large_pieces
from dynhair.training import avatar_folder, capture_recording, recording_of
from stopwatch import Stopwatch
from untrained import started

WARM_UP = 2
AMPLITUDE = 0.2  # of each expression coefficient


@dataclass(frozen=True)
class Speed:
    """Medians over the frames.

    Attributes:
        parts: milliseconds.
        frame: milliseconds of a whole frame.
        work: milliseconds that processors worked on it, all threads together, whatever else the machine did.
    """

    parts: dict[str, float]
    frame: float
    work: float


def main() -> None:
    """Print both avatars' speeds and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="small", choices=list(PRESETS), help="whose sizes are taken")
    parser.add_argument("--size", type=int, default=256, help="pixels of the images' side")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--frames", type=int, default=30, help="that are timed")
    parser.add_argument("--avatar", type=Path, help="a trained one, or its run, in the place of the preset's")
    parser.add_argument("--json", type=Path, help="file that keeps the figures")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    keep_large_blocks()
    with large_pieces(), torch.no_grad():
        avatar, recording = opened(options.avatar) if options.avatar else made_up(options.preset)
        track = driving_track(recording, avatar.head.expression_size, WARM_UP + options.frames)
        camera = recording.camera.resized(options.size, options.size)
        speeds, ratio, difference = measured(avatar, track, camera)
    strands, points = avatar.hair.strands.shape[:2]
    Console().print(
        f"{strands} strands of {points} points, {len(avatar.head.means)} Gaussians of the head, {options.size} pixels, "
        f"threads: {options.threads}",
        highlight=False,
    )
    show(speeds)
    print(f"frozen it is {ratio:.2f} times less work; colours differ by {difference:.1e} at most")
    if options.json is not None:
        figures = {name: dataclasses.asdict(speed) for name, speed in speeds.items()}
        options.json.write_text(json.dumps({**figures, "ratio": ratio}, indent=1) + "\n", encoding="utf-8")


def opened(path: Path) -> tuple[Avatar, Recording]:
    """A trained avatar."""
    return Avatar.load(avatar_folder(path)), recording_of(path)


def made_up(name: str) -> tuple[Avatar, Recording]:
    """An avatar of a preset's sizes, as it is before training, with a deformer that moves the hair a little."""
    torch.manual_seed(0)
    capture = Capture.open(sample_capture())
    avatar = started(capture, preset(name)).avatar.eval()
    for parameter in avatar.hair.deformer.parameters():
        torch.nn.init.normal_(parameter, std=0.02)
    use_precision(avatar, None)
    return avatar, capture_recording(capture)


def driving_track(recording: Recording, expressions: int, frames: int) -> HeadTrack:
    """A head that describes an eight while all of its expressions come and go."""
    track = motion("figure-eight", recording, seconds=frames / recording.fps + 1)
    phases = np.arange(len(track.rotations))[:, None] / recording.fps + np.arange(expressions)
    return dataclasses.replace(track, expressions=(AMPLITUDE * (1 + np.sin(phases)) / 2).astype(np.float32))


def measured(avatar: Avatar, track: HeadTrack, camera: Camera) -> tuple[dict[str, Speed], float, float]:
    """Speeds of both avatars, how many times as much work the first is, and how far their colours lie apart."""
    both = {"as trained": avatar, "frozen": avatar.frozen()}
    watch, difference = watched(list(both.values())), 0.0
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in both}
    for frame in range(len(track.rotations) - round(track.fps)):
        colours = []
        for name, one in both.items():
            began = clocks()
            with watch.round(), watch.part("the rest"):
                colours.append(one.draw(one.pose(track, frame), [camera]).rgb)
            times[name].append((clocks()[0] - began[0], clocks()[1] - began[1]))
        difference = max(difference, float((colours[0] - colours[1]).abs().max()))
    rounds, speeds = watch.rounds, {}
    for turn, name in enumerate(both):
        watch.rounds = rounds[turn :: len(both)][WARM_UP:]
        parts = {part: milliseconds for (part, _), milliseconds in watch.medians().items()}
        frames, work = (statistics.median(spent) for spent in zip(*times[name][WARM_UP:], strict=True))
        speeds[name] = Speed(parts, frames, work)
    slow, quick = (spent[WARM_UP:] for spent in times.values())
    return speeds, statistics.median(a / b for (_, a), (_, b) in zip(slow, quick, strict=True)), difference


def clocks() -> tuple[float, float]:
    """Milliseconds since some moment: of the wall, and of this process's threads."""
    return 1e3 * time.perf_counter(), 1e3 * time.process_time()


def watched(avatars: list[Avatar]) -> Stopwatch:
    """Tell the parts of a frame apart; the avatars share their deformer."""
    stopwatch = Stopwatch()
    deformer = avatars[0].hair.deformer
    if isinstance(deformer, HairDeformer):
        stopwatch.watch(deformer, "embedding", "embedding of the motion")
    for avatar in avatars:
        stopwatch.watch(avatar, "conditions", "motion signals")
        stopwatch.watch(avatar.hair, "forward", "deformer and low-pass")
        stopwatch.watch(avatar.head, "forward", "head networks and pose")
        stopwatch.watch(avatar, "draw", "features of the Gaussians")
    stopwatch.watch(drawing, "drawn_hair", "hair as the camera sees it")
    stopwatch.watch(cpu, "rasterize_cpu", "blend")
    stopwatch.watch(cpu, "list_splats", "projection and binning")
    return stopwatch


def show(speeds: dict[str, Speed]) -> None:
    """Print the table."""
    table = Table("milliseconds", *(f"{name}" for name in speeds))
    parts = dict.fromkeys(part for speed in speeds.values() for part in speed.parts)
    for part in parts:
        table.add_row(part, *(f"{speed.parts.get(part, 0.0):.1f}" for speed in speeds.values()))
    table.add_section()
    table.add_row("a frame", *(f"{speed.frame:.1f}" for speed in speeds.values()))
    table.add_row("processors' work on it", *(f"{speed.work:.1f}" for speed in speeds.values()))
    table.add_row("frames a second", *(f"{1e3 / speed.frame:.1f}" for speed in speeds.values()))
    Console().print(table)


if __name__ == "__main__":
    main()
