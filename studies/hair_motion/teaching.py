"""What `dynhair` knows of hair before it has seen any: dynamics of strands, taught by simulated hair of several kinds.

    python -m studies.hair_motion.teaching OUT

Simulates five hairstyles in OUT, what is not there yet, and writes ``OUT/strand_dynamics.safetensors``, which
dynhair's own is a copy of. Needs Blender (`make blender`, or the variable DYNHAIR_BLENDER). No capture is read: how a
person's hair moves, an avatar learns from the images.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import safetensors.torch
import torch
from rich.console import Console
from studies.hair_motion.grooms import GROOMS
from studies.hair_motion.motions import LESSONS
from studies.hair_motion.recordings import mirrored, recorded
from studies.hair_motion.simulation import simulated
from studies.hair_motion.strand_dynamics import RATE, fit

from dynhair.avatar.strand_dynamics import HIDDEN, POINTS, TAUGHT, StrandDynamics
from dynhair.errors import DynhairError
from dynhair.progress import StageProgress
from dynhair.storage import atomic_file

STEPS, NOISE, SEED = 2600, 0.05, 0


def lessons(folder: Path) -> Iterator[tuple[str, str, Path]]:
    """Groom, motion and file of all that teaches."""
    for groom in GROOMS:
        for motion in LESSONS:
            yield groom, motion, simulated(folder / "simulated", groom, motion)


def recipe(steps: int) -> dict[str, str]:
    """How a network was made, which its file keeps for whoever asks."""
    return {
        "made_by": "studies.hair_motion.teaching",
        "grooms": " ".join(GROOMS),
        "motions": " ".join(LESSONS),
        "mirrored": "yes",
        "steps": str(steps),
        "rate": str(RATE),
        "noise": str(NOISE),
        "seed": str(SEED),
    }


def teach(folder: Path, console: Console, steps: int = STEPS) -> Path:
    """Simulate what is missing, fit, and write the network.

    Raises:
        DynhairError: there is no Blender, or it fails.
    """
    motions = []
    with StageProgress(console).shown() as bars:
        stage = bars.stage("simulating", len(GROOMS) * len(LESSONS))
        for done, (groom, name, path) in enumerate(lessons(folder), start=1):
            motions.append(recorded(path, about_roots=True))
            stage.update(done, f"{groom} {name}")
        torch.manual_seed(SEED)
        network = StrandDynamics(POINTS, HIDDEN, torch.stack([each.canonical.mean((0, 1)) for each in motions]).mean(0))
        stage = bars.stage("teaching", steps)
        fit(network, [*motions, *map(mirrored, motions)], steps, RATE, NOISE, lambda done: stage.update(done, ""))
    path = folder / TAUGHT
    with atomic_file(path) as temporary:
        tensors = {name: value.half() for name, value in network.state_dict().items()}
        safetensors.torch.save_file(tensors, temporary, metadata=recipe(steps))
    return path


def main(arguments: Sequence[str] | None = None) -> int:
    """Teach; 2 where that is impossible."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of simulations and of the network")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    console = Console(stderr=True)
    try:
        console.print(f"Written: {teach(options.out, console)}")
    except DynhairError as error:
        console.print(str(error), style="red", markup=False)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
