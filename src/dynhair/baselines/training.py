"""Training of the baselines, as the avatar's dynamic stage is trained."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dynhair.config import Config

if TYPE_CHECKING:
    from rich.console import Console

BaselineName = Literal["gha", "ga", "simulator"]


def train_baseline(
    name: BaselineName,
    capture: Path,
    out: Path,
    config: Config,
    *,
    avatar: Path | None = None,
    minutes: float | None = None,
    resume: bool = False,
    console: Console | None = None,
) -> None:
    """Train a baseline on a capture's training segments; its head is written to ``out/avatar``.

    The two without strands see the views, image sizes and steps that the configuration's dynamic stage has, in the same
    order. After a kill at any moment, ``resume`` goes on and ends with the same head as an uninterrupted run on the
    same machine.

    Args:
        name: the method: ``gha`` and ``ga`` have no strands, ``simulator`` moves those of a trained avatar.
        capture: the capture's folder; never its ground truth.
        out: the run's folder, new or empty unless resumed.
        config: sizes, iterations, weights, seed; the precision ``auto`` is float32. A resumed run keeps its own.
        avatar: the trained avatar's folder, whose hair and head ``simulator`` takes; the others need none.
        minutes: train no longer than this; the steps so far make the head.
        resume: go on with the run in ``out``.
        console: where progress is shown.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; what was done is saved.
        DynhairError: the capture does not have what training needs; ``out`` is taken, or is no run of this baseline to
            resume; memory or disk do not suffice; too many steps had to be skipped.
    """
    if name == "simulator":
        from dynhair.baselines.simulator import train_simulator

        train_simulator(capture, out, config, avatar, minutes, console)
        return
    from dynhair.baselines.strandless_training import train_strandless

    train_strandless(name, capture, out, config, minutes=minutes, resume=resume, console=console)
