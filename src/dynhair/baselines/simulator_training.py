"""A simulated avatar for a capture: with the defaults of a human hair, or with parameters tuned on its masks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dynhair.avatar import Avatar
from dynhair.baselines.cables import CableParameters
from dynhair.capture import Capture
from dynhair.config import Config
from dynhair.errors import DynhairError
from dynhair.training.run import Run, avatar_folder

if TYPE_CHECKING:
    from rich.console import Console

TRIALS = "trials.json"


def train_simulator(
    capture: Path,
    out: Path,
    config: Config,
    avatar: Path | None,
    minutes: float | None = None,
    console: Console | None = None,
) -> None:
    """Make a run whose avatar is a trained one with simulated hair.

    A run that was cut off goes on where it was: the parameters that were tried are kept.

    Args:
        capture: whose surface the hair collides with, and on whose training segments parameters are tuned.
        out: the run's folder, new or of such a run.
        config: of the avatar's training; the seed is the search's.
        avatar: the trained avatar's folder, or that of its run.
        minutes: how long to tune; none or 0 for the defaults.
        console: where to show progress.

    Raises:
        DynhairError: there is no avatar, the capture does not have what the simulator needs, or ``out`` holds another
            run.
    """
    from dynhair.baselines.simulator import HeadSurface, SimulatedAvatar
    from dynhair.baselines.tuning import HairOverlap, tune

    if avatar is None:
        raise DynhairError("the simulator needs a trained avatar's hair and head", mend="train one, and name it")
    run = Run.open(out) if (out / "run.json").exists() else Run.create(out, capture, config)
    if run.capture != capture.resolve():
        raise DynhairError("the run is of another capture", path=out, expected=str(capture))
    source, opened = Avatar.load(avatar_folder(avatar)), Capture.open(capture)
    surface, parameters = HeadSurface.tracked(opened), CableParameters()
    if minutes:
        overlap = HairOverlap(opened, source, surface)
        parameters = tune(overlap, out / TRIALS, minutes, run.config.training.seed, console)
    SimulatedAvatar(source, surface, parameters).save(out / "avatar")
