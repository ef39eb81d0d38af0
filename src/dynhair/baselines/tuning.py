"""Parameters of the simulator, tuned until the simulated hair covers the hair in the training images."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from rich.console import Console

from dynhair.avatar import Avatar
from dynhair.baselines.cables import CableParameters
from dynhair.capture import Capture, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.metrics import silhouette, silhouette_iou
from dynhair.progress import StageProgress
from dynhair.storage import read_json, write_json
from dynhair.training.frames import hair_mask, training_segments

if TYPE_CHECKING:
    from dynhair.baselines.simulator import HeadSurface

RANGES = {"young": (1e8, 1e12), "relaxation": (1e-3, 0.1), "drag": (0.3, 30.0), "attraction": (0.3, 30.0)}
"""What is tuned, and between which values; all are searched by their logarithms."""

WIDEST, NARROWEST, WIDER, NARROWER = 0.3, 0.03, 1.5, 0.85
"""Standard deviation of a try about the best one, as a share of the range: bounds, and factors on success and failure.

One success in five keeps it as it is (Rechenberg 1973).
"""

TRIAL_GUIDES, TRIAL_SEGMENTS, TRIAL_FRAMES = 60, 2, 8
"""Guides of a trial's hair, the training segments that it is simulated on, and the frames of each that are drawn."""


@dataclass(frozen=True)
class Trial:
    """One try.

    Attributes:
        parameters: that were tried.
        overlap: the hair's IoU with the masks, 0 if the simulation diverged.
        seconds: that it took.
    """

    parameters: CableParameters
    overlap: float
    seconds: float


def best(trials: Sequence[Trial]) -> Trial:
    """The trial of the greatest overlap; the earliest of equals."""
    return max(trials, key=lambda trial: trial.overlap)


def proposed(trials: Sequence[Trial], seed: int) -> CableParameters:
    """What to try next: the defaults, then a random step from the best so far (an evolution strategy, (1 + 1)).

    It depends on its arguments alone, so that a search that was cut off goes on as if it had not been.
    """
    if not trials:
        return CableParameters()
    width, highest = WIDEST, -math.inf
    for index, trial in enumerate(trials):
        better = trial.overlap > highest
        highest = max(highest, trial.overlap)
        if index:
            width = min(WIDEST, width * WIDER) if better else max(NARROWEST, width * NARROWER)
    steps = np.random.default_rng([seed, len(trials)]).normal(0.0, width, len(RANGES))
    chosen = best(trials).parameters
    values = {name: _stepped(getattr(chosen, name), *RANGES[name], s) for name, s in zip(RANGES, steps, strict=True)}
    return dataclasses.replace(chosen, **values)


def tune(
    objective: Callable[[CableParameters], float],
    path: Path,
    minutes: float,
    seed: int,
    console: Console | None = None,
) -> CableParameters:
    """Search for the parameters of the greatest overlap.

    Args:
        objective: the hair's IoU with the masks under given parameters.
        path: where every trial is kept; those that are there already count.
        minutes: how long all trials may take together; the one that passes this is the last.
        seed: of the search.
        console: where to show progress.

    Raises:
        DynhairError: the trials at ``path`` are damaged.
    """
    trials = _read(path) if path.exists() else []
    total, progress = math.ceil(minutes * 60), StageProgress(console or Console(quiet=True))
    with progress.shown():
        stage = progress.stage("tuning, seconds", total, min(total, int(_spent(trials))))
        while _spent(trials) < minutes * 60:
            parameters, began = proposed(trials, seed), time.monotonic()
            try:
                overlap = objective(parameters)
            except DynhairError:  # it diverged
                overlap = 0.0
            trials.append(Trial(parameters, overlap, time.monotonic() - began))
            write_json(path, {"trials": [dataclasses.asdict(trial) for trial in trials]})
            note = f"{len(trials)} tried, hair IoU {best(trials).overlap:.3f}"
            stage.update(min(total, int(_spent(trials))), note)
    return best(trials).parameters


class HairOverlap:
    """Mean IoU of the simulated hair with the hair masks of training segments.

    Of these it takes the ones in which the head accelerates most. It never sees a test segment or the ground truth.

    Args:
        capture: with hair masks.
        avatar: whose hair is simulated.
        surface: that it collides with.

    Raises:
        DynhairError: the capture has no hair masks.
    """

    def __init__(self, capture: Capture, avatar: Avatar, surface: HeadSurface) -> None:
        self._avatar, self._surface = avatar, surface
        lively = sorted(training_segments(capture), key=lambda segment: -_acceleration(capture, segment))
        self._scenes = []
        for segment in lively[:TRIAL_SEGMENTS]:
            indices = np.linspace(0, segment.count - 1, min(TRIAL_FRAMES, segment.count)).round().astype(int)
            for index in indices.tolist():
                requests = [(segment.frames[index], name) for name in capture.camera_names]
                masks = torch.stack([hair_mask(capture, view) for view in capture.views(requests)])
                cameras = [capture.camera(*request) for request in requests]
                self._scenes.append((capture.track(segment), index, cameras, silhouette(masks)))

    @torch.no_grad()
    def __call__(self, parameters: CableParameters) -> float:
        """The overlap under given parameters."""
        from dynhair.baselines.simulator import SimulatedAvatar

        simulated = SimulatedAvatar(self._avatar, self._surface, parameters, TRIAL_GUIDES)
        overlaps = []
        for track, index, cameras, truth in self._scenes:
            images = simulated.draw(simulated.pose(track, index), cameras)
            overlaps.append(silhouette_iou(silhouette(images.hair), truth))
        return torch.cat(overlaps).nanmean().item()


def _acceleration(capture: Capture, segment: Segment) -> float:
    """Root mean square acceleration of the head, of its turning as of a point 10 cm from its origin."""
    track = capture.track(segment)
    places = np.concatenate([track.translations, 0.1 * track.rotations.reshape(len(track.rotations), 9)], 1)
    changes = np.diff(places, n=2, axis=0)
    return float(np.sqrt((changes**2).sum(1).mean())) if len(changes) else 0.0


def _stepped(value: float, low: float, high: float, step: float) -> float:
    place = math.log(max(value, low) / low) / math.log(high / low) + step
    return low * (high / low) ** min(max(place, 0.0), 1.0)


def _spent(trials: Sequence[Trial]) -> float:
    return math.fsum(trial.seconds for trial in trials)


def _read(path: Path) -> list[Trial]:
    try:
        return [
            Trial(CableParameters(**trial["parameters"]), float(trial["overlap"]), float(trial["seconds"]))
            for trial in read_json(path)["trials"]
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise DynhairError(f"damaged ({error})", path=path, mend="delete it: the search begins anew") from None
