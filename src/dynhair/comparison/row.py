"""One row in a process of its own: ``python -m dynhair.comparison.row FOLDER ROW``.

It trains what is not trained and measures what is not measured. Standard input is its leash: once that is closed,
because rows are to stop or because what started them has died, it stops as if by Ctrl-C, which saves.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, cast

from dynhair.errors import DynhairError

if TYPE_CHECKING:
    from rich.console import Console

    from dynhair.comparison.record import Comparison, Row

INTERRUPTED = 130
MOST_TUNING = 60.0  # minutes


def make_row(path: Path, name: str) -> None:
    """Train and measure a row of a comparison, and have other people drive it, as far as it is not done.

    Args:
        path: the comparison's folder.
        name: of the row, whose folder has begun.

    Raises:
        KeyboardInterrupt: it is to stop; what was done is saved.
        DynhairError: training or evaluation cannot go on.
    """
    from rich.console import Console

    from dynhair.comparison.methods import HAIR, SIMULATORS
    from dynhair.comparison.record import Comparison
    from dynhair.comparison.rows import done, driven, trained

    comparison, console = Comparison.read(path), Console(width=140)
    row = comparison.rows[name]
    if not trained(comparison, row):
        _train(comparison, row, console)
    if row.method == HAIR:
        return
    from dynhair.evaluation import run_evaluation

    avatar = path / row.folder / "avatar"
    if not done(comparison, row):
        # Simulating takes most of an evaluation, and a comparison's tables are of held-out motions.
        training = row.method not in SIMULATORS
        out = path / row.folder / "evaluation"
        run_evaluation(avatar, comparison.capture, out, training=training, console=console)
    for driver, capture in comparison.drivers.items():
        out = driven(comparison, row) / driver
        if not (out / "metrics.json").exists():
            run_evaluation(avatar, capture, out, reenact=True, console=console)


def _train(comparison: Comparison, row: Row, console: Console) -> None:
    """Train a row, from where its folder has got to."""
    from dynhair.comparison.methods import BASELINES, HAIR, SIMULATORS, method_config, row_name

    folder, capture = comparison.path / row.folder, comparison.capture
    config = method_config(comparison.config, row.method, row.seed)
    if row.method in BASELINES:
        from dynhair.baselines import BaselineName, train_baseline

        simulated = row.method in SIMULATORS
        ours = row_name("ours", row.seed)
        train_baseline(
            "simulator" if simulated else cast(BaselineName, row.method),
            capture,
            folder,
            config,
            avatar=comparison.folder(ours) / "avatar" if simulated else None,
            minutes=tuning_minutes(comparison.rows[ours]) if row.method == "simulator-tuned" else None,
            resume=True,
            console=console,
        )
        return
    from dynhair.training.trainer import STAGES, train

    shared = ("mesh", "static") if config.head.start == "mesh" else ("static",)
    train(capture, folder, stages=shared if row.method == HAIR else STAGES, resume=True, console=console)


def tuning_minutes(ours: Row) -> float:
    """How long the simulator is tuned: as long as our row was trained, and an hour at most or where that is unknown."""
    return MOST_TUNING if ours.seconds_trained is None else min(ours.seconds_trained / 60, MOST_TUNING)


def hold_leash() -> None:
    """Interrupt this process once its standard input is closed, even if it was started to ignore Ctrl-C."""

    def wait() -> None:
        while os.read(0, 1):  # not sys.stdin, whose lock the end of the process would wait for
            pass
        os.kill(os.getpid(), signal.SIGINT)

    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=wait, daemon=True).start()


def main(path: str, name: str) -> int:
    """Make a row; the exit status says how that went."""
    hold_leash()
    try:
        make_row(Path(path), name)
    except KeyboardInterrupt:
        return INTERRUPTED
    except DynhairError as error:
        print(error, flush=True)
        return 2
    except Exception:
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
