"""The hair deformer, forward and backward: all points of a strand against its knots, beside the arithmetic floor.

    python benchmarks/deformer.py [--preset tiny|small|medium|paper] [--threads 1] [--knots 8] [--json FILE]

On made-up strands, in float32. The floor is the multiplications of the point network alone, at the rate that a hidden
layer's matrix product reaches on the same machine at the same moment.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import torch

from dynhair.avatar import PaperDeformer
from dynhair.avatar.chunked import CHUNK
from dynhair.config import DeformerConfig
from dynhair.motion import signal_names
from dynhair.presets import PRESETS, preset
from dynhair.threads import keep_large_blocks, large_pieces

ROUNDS = 15
PRODUCTS = 10


@dataclass(frozen=True)
class Cost:
    """Medians over the rounds, in milliseconds.

    Attributes:
        knots: points of a strand that the network is evaluated at.
        milliseconds: of one forward and backward.
        floor: of its multiplications alone.
        above_floor: their ratio, within each round.
    """

    knots: int
    milliseconds: float
    floor: float
    above_floor: float


def main() -> None:
    """Print the costs and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="small", choices=PRESETS, help="whose sizes are taken")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--knots", type=int, default=8, help="in the place of the preset's")
    parser.add_argument("--json", type=Path, help="file that keeps the figures")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    keep_large_blocks()
    hair = preset(options.preset).hair
    knots = [0, options.knots]
    with large_pieces():
        costs, ratio = measured(hair.strands, hair.points, hair.deformer, knots, options.threads)
    print(f"{hair.strands} strands of {hair.points} points, {options.threads} threads")
    for cost in costs:
        print(
            f"{cost.knots:3d} knots: {cost.milliseconds:.1f} ms, {cost.above_floor:.2f} times its floor of "
            f"{cost.floor:.1f} ms"
        )
    print(f"all points take {ratio:.2f} times as long")
    if options.json is not None:
        figures = {"costs": [asdict(cost) for cost in costs], "ratio": ratio}
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def measured(
    strands: int, points: int, config: DeformerConfig, knots: list[int], threads: int
) -> tuple[list[Cost], float]:
    """Costs of each number of knots, and the ratio of the first to the last; all in turns, so that noise hits alike."""
    generator = torch.Generator().manual_seed(0)
    canonical = 0.1 * torch.randn(strands, points, 3, generator=generator)
    window = torch.randn(config.history + 1, 3 * len(signal_names(config)), generator=generator)
    gradient = torch.randn(strands, points, 3, generator=generator)
    deformers = [PaperDeformer(canonical, replace(config, knots=count)) for count in knots]
    left, right = torch.randn(CHUNK, config.width), torch.randn(config.width, config.width)

    def step(deformer: PaperDeformer) -> None:
        deformer.zero_grad(set_to_none=True)
        deformer(window).backward(gradient)

    def products() -> None:
        for _ in range(PRODUCTS):
            _ = left @ right

    for deformer in deformers:
        step(deformer)  # warms up
    rounds = []
    for _ in range(ROUNDS):
        times = [elapsed(lambda deformer=deformer: step(deformer)) for deformer in deformers]
        rate = PRODUCTS * CHUNK * config.width**2 / elapsed(products)  # multiplications a millisecond on one thread
        rounds.append((times, [multiplications(deformer) / rate / threads for deformer in deformers]))
    costs = [
        Cost(
            deformer.spline.shape[1],
            statistics.median(times[number] for times, _ in rounds),
            statistics.median(floors[number] for _, floors in rounds),
            statistics.median(times[number] / floors[number] for times, floors in rounds),
        )
        for number, deformer in enumerate(deformers)
    ]
    return costs, statistics.median(times[0] / times[-1] for times, _ in rounds)


def multiplications(deformer: PaperDeformer) -> int:
    """Of the point network forward and backward; the first layer's inputs need no gradient."""
    config = deformer.config
    sizes = (deformer.code.shape[1], *[config.width] * config.layers, 3)
    first, *rest = [a * b for a, b in itertools.pairwise(sizes)]
    return len(deformer.code) * (2 * first + 3 * sum(rest))


def elapsed(work: Callable[[], None]) -> float:
    """Milliseconds of one call."""
    began = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - began)


if __name__ == "__main__":
    main()
