"""`dynhair compare` and `dynhair ablate`: from a capture to a folder of rows, each trained and measured alike."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import torch
from rich.console import Console

from dynhair.ablations import ABLATIONS, AblationName
from dynhair.capture import Capture
from dynhair.comparison.budget import MemoryEstimates, memory_budget, stated_memory
from dynhair.comparison.folder_lock import locked
from dynhair.comparison.methods import HAIR, MethodName, changes_nothing, row_name
from dynhair.comparison.options import RowOptions
from dynhair.comparison.plan import ablated_rows, compared_rows, measured_memory, tasks
from dynhair.comparison.record import Comparison, Row, TableName
from dynhair.comparison.rows import done, take_avatar, take_hair
from dynhair.comparison.schedule import Schedule
from dynhair.comparison.watching import result_table
from dynhair.comparison.workers import Command, Workers, row_command
from dynhair.config import Config, DeformerKind
from dynhair.errors import DynhairError
from dynhair.presets import PRESETS, chosen_config
from dynhair.threads import thread_count
from dynhair.training.frames import training_segments
from dynhair.training.run import Run
from dynhair.training.trainer import with_precision

METHODS: tuple[MethodName, ...] = get_args(MethodName)
REPORT = "report"


def run_comparison(
    capture: Path,
    out: Path,
    options: RowOptions,
    *,
    methods: Sequence[MethodName] = METHODS,
    avatar: Path | None = None,
    drivers: Sequence[Path] = (),
    console: Console | None = None,
    command: Command = row_command,
) -> bool:
    """Train and measure methods on one capture: the same split, steps, views and image sizes.

    What is done is kept: the same call goes on where it was, and others may add methods, seeds and drivers.

    Args:
        capture: the capture's folder.
        out: the comparison's folder.
        options: how rows are trained.
        methods: which.
        avatar: a trained run that is taken as ours; all others then have its configuration.
        drivers: captures of other people, whose motions drive all methods once they are trained.
        console: where progress is shown.
        command: what makes a row.

    Returns:
        Whether all rows asked for are done.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; rows have saved what they had.
        DynhairError: a capture or the run cannot be read; a driver is the capture itself; ``out`` holds a comparison of
            something else; another process is at work there.
    """
    run = None if avatar is None else _trained_run(avatar, capture, options)
    if run is None:
        config, preset = chosen_config(options.preset, None, options.iterations, None), options.preset
    else:
        config, preset = run.config, _preset_of(run.config)
        if "ours" not in methods:
            methods = ("ours", *methods)
    asked = _asked("baselines", capture, out, preset, config, compared_rows(methods, options.seeds))
    asked.drivers = _drivers(asked.capture, drivers)
    return _finish(asked, options, console or Console(), command, run)


def run_ablation(
    capture: Path,
    out: Path,
    options: RowOptions,
    *,
    rows: Sequence[AblationName] = ABLATIONS,
    deformer: DeformerKind | None = None,
    console: Console | None = None,
    command: Command = row_command,
) -> bool:
    """Train and measure our method and what is left of it without its parts, one at a time.

    Args:
        capture: the capture's folder.
        out: the comparison's folder.
        options: how rows are trained.
        rows: the parts; those that the preset does not have are left out, which is said.
        deformer: what moves the hair, if not as in the preset.
        console: where progress is shown.
        command: what makes a row.

    Returns:
        Whether all rows asked for are done.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; rows have saved what they had.
        DynhairError: as for :func:`run_comparison`.
    """
    console, preset = console or Console(), options.preset
    config = chosen_config(preset, None, options.iterations, None, deformer)
    for name in [name for name in rows if changes_nothing(config, name)]:
        console.print(
            f"{name} is left out: preset {preset} does not have what it takes away.", highlight=False, soft_wrap=True
        )
    chosen = [name for name in rows if not changes_nothing(config, name)]
    asked = _asked("ablations", capture, out, preset, config, ablated_rows(chosen, options.seeds))
    return _finish(asked, options, console, command)


def _asked(table: TableName, capture: Path, out: Path, preset: str, config: Config, rows: list[Row]) -> Comparison:
    """The comparison that is asked for, before looking at what there is of it."""
    if not rows:
        raise DynhairError("no rows are asked for", expected="a seed, and a method or ablation")
    opened = Capture.open(capture, cache_bytes=0)
    training_segments(opened)  # without any it is refused before there is a folder
    # rows have seeds of their own
    config = dataclasses.replace(config, training=dataclasses.replace(config.training, seed=0))
    return Comparison(out.resolve(), table, opened.path.resolve(), preset, config, {row.name: row for row in rows})


def _drivers(capture: Path, paths: Sequence[Path]) -> dict[str, Path]:
    """Captures of other people by the names of their folders.

    Raises:
        DynhairError: one cannot be read, is the compared capture itself, or has another one's name.
    """
    drivers: dict[str, Path] = {}
    for path in paths:
        driver = Capture.open(path, cache_bytes=0).path.resolve()
        if driver == capture:
            raise DynhairError(
                "the capture that is compared on cannot drive what it is the truth of",
                path=path,
                expected="another person's",
            )
        if drivers.setdefault(driver.name, driver) != driver:
            raise DynhairError(f"two drivers are named '{driver.name}'", path=path, mend="rename one of the folders")
    return drivers


def _finish(
    asked: Comparison, options: RowOptions, console: Console, command: Command, ours: Run | None = None
) -> bool:
    """Make the rows that are asked for, and the report on all that the folder has."""
    names = list(asked.rows)
    with locked(asked.path, console) as lock:
        comparison = _begun(asked)
        if ours is not None:
            _take(ours, comparison)
        left = tasks(comparison, names)
        estimates = MemoryEstimates(stated_memory(comparison.config), measured_memory(comparison))
        cores = thread_count()
        at_once = options.jobs or (1 if torch.cuda.is_available() else cores)
        schedule = Schedule(left, at_once, memory_budget(options.memory), estimates)
        threads = max(cores // max(min(at_once, len(left)), 1), 1)
        try:
            Workers(comparison, schedule, estimates, threads, console, command=command, inherited=[lock]).finish()
        except KeyboardInterrupt:
            console.print("Stopped; the same command goes on where it was.", highlight=False)
            raise
        _report(comparison, console)
    wanted = [comparison.rows[name] for name in names]
    return all(row.state == "done" for row in wanted if row.method != HAIR)


def _begun(asked: Comparison) -> Comparison:
    """The comparison in the folder, with the rows that are asked for; what had failed is tried again."""
    if not Comparison.exists(asked.path):
        asked.config = with_precision(asked.config)
        asked.create()
        return asked
    comparison = Comparison.read(asked.path)
    comparison.require_same(asked)
    rows = {**asked.rows, **comparison.rows}
    comparison.rows = {name: rows[name] for name in sorted(rows, key=lambda name: rows[name].seed)}
    comparison.drivers |= asked.drivers
    for name, row in list(comparison.rows.items()):  # folders are right where a kill came before the record
        if done(comparison, row):
            comparison.change(name, state="done", error=None)
        elif not comparison.folder(name).exists():
            comparison.change(name, state="pending", error=None, seconds_trained=0.0, peak_memory=None)
        elif row.state == "done" or name in asked.rows:
            comparison.change(name, state="pending", error=None)
    comparison.write()
    return comparison


def _trained_run(path: Path, capture: Path, options: RowOptions) -> Run:
    """The run that is taken as ours.

    Raises:
        DynhairError: it has no avatar, or is of another capture, seed or length.
    """
    run = Run.open(path)
    trained = run.config.training
    if not (run.avatar / "avatar.json").exists():
        raise DynhairError("the run has no avatar yet", path=path, mend=f"dynhair train ... --out {path} --resume")
    if run.capture != capture.resolve():
        raise DynhairError(f"the run was trained on {run.capture}", path=path, expected=str(capture.resolve()))
    if trained.seed not in options.seeds:
        raise DynhairError(
            f"the run's seed is {trained.seed}", path=path, expected=f"one of {', '.join(map(str, options.seeds))}"
        )
    if options.iterations not in (None, trained.iterations):
        raise DynhairError(
            f"the run was trained for {trained.iterations} steps",
            path=path,
            expected=f"{options.iterations}, as asked for by --iterations",
            mend="leave out --iterations: all others are then trained for as long as this run",
        )
    return run


def _preset_of(config: Config) -> str:
    """The preset that a configuration is, but for seed, steps and precision; ``own`` for none."""
    training = config.training

    def plain(preset: Config) -> Config:
        same = dataclasses.replace(
            preset.training, seed=training.seed, iterations=training.iterations, precision=training.precision
        )
        return dataclasses.replace(preset, training=same)

    return next((name for name, preset in PRESETS.items() if plain(preset) == config), "own")


def _take(run: Run, comparison: Comparison) -> None:
    """Let a trained run be our row of its seed, and its canonical hair that of the other rows."""
    seed = run.config.training.seed
    name = row_name("ours", seed)
    take_avatar(run, comparison.folder(name))
    take_hair(run, comparison.folder(row_name(HAIR, seed)))
    comparison.change(name, seconds_trained=None)
    comparison.write()


def _report(comparison: Comparison, console: Console) -> None:
    from dynhair.report import write_report

    console.print(result_table(row for row in comparison.rows.values() if row.method != HAIR))
    if any(row.state == "done" and row.method != HAIR for row in comparison.rows.values()):
        write_report([comparison.path], comparison.path / REPORT, console)
