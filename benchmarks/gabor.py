"""Speed of orientation maps on one thread, against filtering with each of the bank's 180 filters.

    python benchmarks/gabor.py [--json FILE]

Times are the processor's, not the wall clock's, so that other programs disturb them less.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import cv2
import numpy as np
import torch

from dynhair.preprocess.orientation import BAND, FILTERS, LUMA, gabor_filters, gabor_orientation

SIZES = {"256 x 256": (256, 256), "1024 x 1024": (1024, 1024), "2200 x 3208": (3208, 2200)}
REPEATS = 5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures there")
    arguments = parser.parse_args()

    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    generator = np.random.default_rng(0)
    figures = {}
    for name, (height, width) in SIZES.items():
        image = generator.integers(0, 256, (height, width, 3), dtype=np.uint8)
        figures[name] = measure(partial(gabor_orientation, image), REPEATS) * 1e6 / (height * width)
        print(f"{name:12}{figures[name]:8.0f} ms a megapixel")
    image = generator.integers(0, 256, (512, 512, 3), dtype=np.uint8)
    figures["ratio"] = measure(partial(plainly, image), 1) / measure(partial(gabor_orientation, image), REPEATS)
    print(f"{FILTERS} calls of cv2.filter2D take {figures['ratio']:.0f} times as long at 512 x 512")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


def plainly(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate single pixels' orientation and variance by every filter of the bank."""
    luma = cv2.transform(image.astype(np.float32), np.array([LUMA], np.float32) / 255)
    band = cv2.GaussianBlur(luma, (0, 0), BAND[0]) - cv2.GaussianBlur(luma, (0, 0), BAND[1])
    angles = np.arange(FILTERS) / FILTERS
    filters = gabor_filters(np.pi * angles).astype(np.float32)
    responses = np.stack([np.abs(cv2.filter2D(band, -1, kernel)) for kernel in filters])
    best = angles[responses.argmax(0)].astype(np.float32)
    variance = np.zeros_like(best)
    for angle, response in zip(angles, responses, strict=True):
        apart = np.abs(best - np.float32(angle))
        variance += np.minimum(apart, 1 - apart) ** 2 * response
    return best, variance / responses.sum(0)


def measure(run: Callable[[], object], repeats: int) -> float:
    """Milliseconds of processor time, the median."""
    run()
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        run()
        times.append(time.thread_time() - start)
    return 1e3 * statistics.median(times)


if __name__ == "__main__":
    main()
