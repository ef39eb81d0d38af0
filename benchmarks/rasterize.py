"""Speed of the CPU rasterizer on a head of hair: one thread, 8 channels, forward and backward.

    python benchmarks/rasterize.py [--json FILE]

Times are the processor's, not the wall clock's, so that other programs disturb them less.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import torch
from torch import Tensor

from dynhair.render import Gaussians, rasterize
from dynhair.render.kernels import blend
from dynhair.render.parallel import share_tiles
from dynhair.render.tiling import list_splats, pack_camera
from dynhair.render.warp_runtime import warp
from dynhair.render.workspace import Workspace
from scene import hair_camera, hair_scene

SCENES = {"117k hair + 30k head": (3_000, 30_000), "429k hair + 100k head": (11_000, 100_000)}
SIZES = (256, 512, 1024)
CHANNELS = 8
REPEATS = 7
ATTRIBUTES = ("means", "quats", "scales", "opacities", "features")
# Of one splat on one pixel, multiplications and additions: exponent 9, exp2 14, alpha and transmittance 5, each of nine
# channels 2; and in the backward pass the first three again, then channels 4, and what follows from alpha 20.
FLOPS_FORWARD, FLOPS_BACKWARD = 28 + 2 * (CHANNELS + 1), 28 + 4 * (CHANNELS + 1) + 20


@dataclass(frozen=True)
class Cell:
    """One scene at one size; times in milliseconds, medians."""

    scene: str
    size: int
    forward: float
    backward: float
    total: float
    pairs: int  # of pixels and Gaussians that were blended, whole 4 x 4 blocks
    share_of_peak: float  # of the machine's multiply-add rate on one thread, over the whole pass
    peak_memory: float  # MiB, of the process so far


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures there")
    arguments = parser.parse_args()

    torch.set_num_threads(1)
    peak = fma_peak()
    print(f"multiply-add peak of one thread: {peak:.0f} GFLOP/s")
    print(f"{'scene':24}{'px':>6}{'forward':>10}{'backward':>10}{'total ms':>10}{'of peak':>9}{'peak MiB':>10}")
    cells = []
    for name, (strands, head) in SCENES.items():
        gaussians = leaves(hair_scene(strands, head, CHANNELS))
        for size in SIZES:
            cell = measure(name, gaussians, size, peak)
            cells.append(cell)
            print(
                f"{name:24}{size:6}{cell.forward:10.1f}{cell.backward:10.1f}{cell.total:10.1f}"
                f"{cell.share_of_peak:9.1%}{cell.peak_memory:10.0f}"
            )
    ratio = ratio_to_reference()  # last, as it takes the most memory
    print(f"plain PyTorch takes {ratio:.0f} times as long for 2,800 Gaussians at 128 px")
    if arguments.json:
        figures = {"fma_peak_gflops": peak, "ratio_to_pytorch": ratio, "cells": [asdict(cell) for cell in cells]}
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


def measure(scene: str, gaussians: Gaussians, size: int, peak: float) -> Cell:
    passes = [timed_pass(gaussians, size) for _ in range(REPEATS + 2)][2:]
    total = statistics.median(sum(each) for each in passes)
    pairs = blended_pairs(gaussians, size)
    return Cell(
        scene=scene,
        size=size,
        forward=statistics.median(forward for forward, _ in passes),
        backward=statistics.median(backward for _, backward in passes),
        total=total,
        pairs=pairs,
        share_of_peak=pairs * (FLOPS_FORWARD + FLOPS_BACKWARD) / (total * 1e6) / peak,
        peak_memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10),
    )


def timed_pass(gaussians: Gaussians, size: int, backend: str = "cpu") -> tuple[float, float]:
    """Milliseconds of a forward and of a backward pass, with gradients from features and alpha."""
    for name in ATTRIBUTES:
        getattr(gaussians, name).grad = None
    start = time.thread_time()
    rendering = rasterize(gaussians, hair_camera(size), backend=backend)  # pyright: ignore[reportArgumentType]
    middle = time.thread_time()
    images = [rendering.features, rendering.alpha]
    gradients = [torch.ones_like(image) for image in images]
    ready = time.thread_time()
    torch.autograd.backward(images, gradients)
    return 1e3 * (middle - start), 1e3 * (time.thread_time() - ready)


def ratio_to_reference() -> float:
    """How many times as long plain PyTorch takes, on a scene small enough for it."""
    gaussians = leaves(hair_scene(60, 460, CHANNELS))

    def seconds(backend: str, repeats: int) -> float:
        return statistics.median(sum(timed_pass(gaussians, 128, backend)) for _ in range(repeats))

    seconds("cpu", 1)
    return seconds("reference", 1) / seconds("cpu", REPEATS)


def blended_pairs(gaussians: Gaussians, size: int) -> int:
    """Count the pairs of pixels and Gaussians that the blend computed."""
    with torch.no_grad():
        view = pack_camera(hair_camera(size))
        attributes = [getattr(gaussians, name) for name in ATTRIBUTES]
        workspace = Workspace()
        (lists,) = list_splats(workspace, attributes[:4], attributes[4], view[None], size, size)
        images = torch.empty(size, size, CHANNELS), torch.empty(size, size), torch.empty(size, size)
        ((first, last),) = share_tiles(lists.starts, 1)
        blend(CHANNELS)(first, last, size, size, CHANNELS, *lists.tensors, *images)
        tile = torch.searchsorted(lists.starts[1:].contiguous(), torch.arange(len(lists.entries)), right=True)
        looked_at = torch.arange(len(lists.entries)) < lists.ends[tile]
        return 16 * count_bits(lists.reached[looked_at])


def count_bits(words: Tensor) -> int:
    return sum(int(((words.int() >> bit) & 1).sum()) for bit in range(16))


def leaves(gaussians: Gaussians) -> Gaussians:
    return Gaussians(*(getattr(gaussians, name).requires_grad_() for name in ATTRIBUTES))


def fma_peak() -> float:
    """Measure the multiply-adds of one thread, GFLOP/s: independent chains of full vectors in registers."""
    wp = warp()
    loop = fma_loop(wp)
    rounds = 20_000_000
    sink = wp.zeros(16, dtype=wp.float32, device="cpu")
    best = float("inf")
    for _ in range(4):
        start = time.thread_time()
        wp.launch(loop, dim=1, inputs=[rounds, sink], device="cpu")
        best = min(best, time.thread_time() - start)
    return rounds * 12 * 16 * 2 / best * 1e-9


def fma_loop(wp) -> Callable:
    snippet = """
    typedef float Vec __attribute__((ext_vector_type(16)));
    Vec v[12];
    for (int k = 0; k < 12; ++k) v[k] = (float)k;
    for (int i = 0; i < rounds; ++i)
#pragma unroll
        for (int k = 0; k < 12; ++k) v[k] = __builtin_elementwise_fma(v[k], (Vec)0.999999f, (Vec)1e-6f);
    for (int k = 1; k < 12; ++k) v[0] += v[k];
    for (int l = 0; l < 16; ++l) sink.data[l] = v[0][l];
    """

    def body(rounds, sink): ...

    def entry(rounds, sink):
        body(rounds, sink)

    body.__annotations__ = entry.__annotations__ = {"rounds": int, "sink": wp.array(dtype=wp.float32)}
    body = wp.func_native(snippet)(body)
    flags = "-march=native -mprefer-vector-width=512"
    return wp.kernel(entry, module="unique", enable_backward=False, module_options={"cpu_compiler_flags": flags})


if __name__ == "__main__":
    main()
