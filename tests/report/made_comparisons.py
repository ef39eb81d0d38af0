"""Comparison folders made on the spot: figures as a test wants them, small videos, smooth series."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynhair.pictures import grid
from dynhair.video import video_writer

SIZE = (48, 40)
"""Width and height of the evaluated images, which videos show as they are."""

FRAMES = 8
GROUND = {"truth": (200, 40, 40), "ours": (40, 200, 40), "gha": (40, 40, 200), "ga": (200, 200, 40)}
"""Colours by which the panels of videos are told apart."""


def made_row(
    folder: Path,
    method: str,
    figures: Mapping[str, float | None],
    *,
    label: str | None = None,
    seed: int = 0,
    state: str = "done",
    error: str | None = None,
    reasons: Mapping[str, str] | None = None,
    protocol: Mapping[str, str] | None = None,
    segments: Sequence[str] = ("nod",),
    videos: bool = False,
    held_out: Mapping[str, float | None] | None = None,
    driven_by: str | None = None,
) -> dict[str, Any]:
    """Write a row's evaluation and give its entry in ``comparison.json``."""
    name = f"{method}-seed{seed}"
    if state == "done":
        evaluation = folder / name / "evaluation"
        evaluation.mkdir(parents=True)
        said = {"views": "all 1: front", "networks": "LPIPS", **(protocol or {})}
        metrics = {
            **figures,
            "samples": {key: 16 for key, value in figures.items() if value is not None},
            "reasons": {key: "no reason" for key, value in figures.items() if value is None} | dict(reasons or {}),
            "segments": {
                "turn": {"split": "train"},
                **{segment: {"split": "test", **figures} for segment in segments},
            },
            "held_out_views": {"views": [], "reason": "none"} if held_out is None else {"views": ["side"], **held_out},
            "cost": {"frames": 8, "views": 1, "seconds": 4.0, "seconds_per_100_frames_and_view": 50.0},
            "protocol": said,
            "image_size": SIZE,
            "definitions": {"psnr": "dB, -10 log10(MSE)"},
        }
        (evaluation / "metrics.json").write_text(json.dumps(metrics))
        write_series(evaluation / "series.npz", segments)
        if videos:
            for segment in segments:
                write_video(evaluation / f"test_{segment}.mp4", method)
        if driven_by is not None:
            driven = folder / name / "driven_by" / driven_by
            driven.mkdir(parents=True)
            (driven / "metrics.json").write_text(json.dumps({**metrics, "held_out_views": {}}))
            write_video(driven / "cross_nod.mp4", method)
    return {
        "name": name,
        "label": label or {"ours": "Ours", "gha": "GHA", "ga": "GA"}.get(method, method),
        "method": method,
        "seed": seed,
        "folder": name,
        "seconds_trained": 3725.0,
        "state": state,
        "error": error,
    }


def made_comparison(
    folder: Path,
    rows: Sequence[Mapping[str, Any]],
    *,
    table: str = "baselines",
    capture: str = "captures/long",
    drivers: Sequence[str] = (),
) -> Path:
    """Write ``comparison.json``."""
    folder.mkdir(parents=True, exist_ok=True)
    value = {
        "kind": "dynhair comparison",
        "table": table,
        "capture": capture,
        "iterations": 1500,
        "preset": "small",
        "rows": list(rows),
        "drivers": {name: f"captures/{name}" for name in drivers},
    }
    (folder / "comparison.json").write_text(json.dumps(value))
    return folder


def write_series(path: Path, segments: Sequence[str]) -> None:
    """Write smooth curves of every series."""
    time = np.arange(FRAMES, dtype=np.float32) / 30
    arrays = {}
    for segment in segments:
        arrays[f"{segment}/time"] = time
        for name in ("tip_speed", "tip_speed_truth", "hair_tiou", "hair_tiou_truth", "hair_iou", "tip_error_mm"):
            arrays[f"{segment}/{name}"] = np.sin(9 * time + len(name)).astype(np.float32)
    np.savez(path, **arrays)


def write_video(path: Path, method: str, frames: int = FRAMES) -> None:
    """Write a video as an evaluation does: the truth, the method, and their difference, of one colour each."""
    with video_writer(path, 30.0) as append:
        for index in range(frames):
            colours = (GROUND["truth"], GROUND.get(method, (120, 120, 120)), (0, 0, 0))
            panels = [np.full((SIZE[1], SIZE[0], 3), colour, np.uint8) for colour in colours]
            for panel in panels:
                panel[:, index * 4 : index * 4 + 4] //= 2
            append(grid([panels], [""], ["truth", "avatar", "difference"]))
