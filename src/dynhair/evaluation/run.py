"""Avatars on disk, evaluated against or driven by captures on disk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text
from torch import Tensor

from dynhair import __version__
from dynhair.avatar import Avatar
from dynhair.baselines import open_driven_head
from dynhair.capture import Capture
from dynhair.device import best_device
from dynhair.errors import DynhairError
from dynhair.evaluation import reenactment
from dynhair.evaluation.appearance import Appearance
from dynhair.evaluation.expressions import ExpressionSheet
from dynhair.evaluation.hairstyle import HairstyleEvaluation, evaluate_hairstyles
from dynhair.evaluation.held_out import HeldOutViews, held_out_views, same_folder
from dynhair.evaluation.protocol import DrivenHead, evaluate_avatar, evaluated_indices, evaluated_segments
from dynhair.evaluation.recorder import Recorder, ReenactmentRecorder
from dynhair.evaluation.records import EvaluatedFrame, Evaluation
from dynhair.evaluation.report import evaluation_table, hairstyle_table, reenactment_table
from dynhair.evaluation.retargeting import another_person
from dynhair.evaluation.series import write_series
from dynhair.storage import write_json
from dynhair.threads import large_pieces
from dynhair.training.run import Run, avatar_folder, read_hair

METRICS = "metrics.json"
SERIES_FILE = "series.npz"


@dataclass(frozen=True)
class RunEvaluation:
    """What was measured.

    Attributes:
        motion: the avatar driven by the capture's motions; None for a run that has no avatar yet.
        hairstyle: the hair at rest; None where it could not be measured, which is then printed.
    """

    motion: Evaluation | None
    hairstyle: HairstyleEvaluation | None


def run_evaluation(
    path: Path | str,
    capture_path: Path | str,
    out: Path | str,
    *,
    reenact: bool = False,
    training: bool = True,
    appearance: Appearance | None = None,
    device: torch.device | str | None = None,
    console: Console | None = None,
) -> RunEvaluation:
    """Evaluate an avatar, or what a run has so far, against a capture; print tables, and write figures and pictures.

    Of a run whose static stage alone is done, the hair at rest is evaluated. That of an edited avatar is evaluated as
    it was trained and as edits leave it. A capture of another person than the run's drives the avatar, before the run's
    own cameras; then no image is true, and only how the hair moves is measured.

    Args:
        path: the avatar's folder, or the run's.
        capture_path: the capture's folder.
        out: folder for ``metrics.json`` and, of an avatar, ``series.npz``, ``test_<segment>.mp4``,
            ``contact_sheet.png`` and, where expressions vary, ``expressions.png``; or ``cross_<segment>.mp4`` of an
            avatar that another person drives.
        reenact: whether the capture shows another person even if the heads are too alike to tell.
        training: whether an avatar is also measured on training segments, and not on those held out alone.
        appearance: networks that compare images; the published ones when left out.
        device: where the avatar is posed and rendered; a GPU where there is one, when left out.
        console: where progress and tables go; standard output when left out.

    Raises:
        DynhairError: the avatar, the run or the capture cannot be read; or the run has no hair yet.
    """
    path, out, console = Path(path), Path(out), console or Console()
    run = _run_of(path)
    hairstyles = {} if run is None else _stages_of_hair(run)
    widths: dict[str, Float[Tensor, " _"]] = {}
    capture = Capture.open(capture_path, cache_bytes=0)  # views are read once
    figures: dict[str, Any] = {"dynhair": __version__, "avatar": path.resolve().name}
    motion, written = None, []
    if avatar_folder(path).exists() or not hairstyles:
        avatar = open_driven_head(path, device or best_device())
        own = _own_capture(run, capture)
        if reenact and own is None:
            raise DynhairError(
                "not known on which capture it was trained, or that is gone, or is the one that should drive it",
                path=path,
                expected="an avatar in its run, whose capture is there, and another capture",
            )
        if own is not None and (reenact or another_person(own, capture)):
            return RunEvaluation(_reenact(avatar, own, capture, figures, out, console), None)
        own_hair = getattr(avatar, "canonical_strands", None)
        hairstyles = hairstyles or ({} if own_hair is None else {"canonical": own_hair})
        if isinstance(avatar, Avatar) and avatar.edits:
            hairstyles = {"canonical": hairstyles["canonical"], "edited": avatar.resting_strands}
            widths = {"edited": avatar.look.widths}
        held_out = held_out_views(run, capture)
        motion, written = _evaluate_motion(avatar, capture, held_out, training, appearance, out, console)
        figures.update(motion.to_json())
        console.print(evaluation_table(motion))
    hairstyle = None
    try:
        with console.status("evaluating the hair at rest"), large_pieces():
            hairstyle = _evaluate_hairstyles(capture, hairstyles, widths)
        figures["hairstyle"] = hairstyle.to_json()
        console.print(hairstyle_table(hairstyle))
    except DynhairError as error:
        if motion is None:
            raise
        figures["hairstyle"] = {"reason": error.message}
        console.print(Text(f"n/a: the hair at rest: {error.message}", style="dim"))
    write_json(out / METRICS, figures)
    for file in (out / METRICS, *written):
        console.print(f"wrote {file}", highlight=False, soft_wrap=True)
    return RunEvaluation(motion, hairstyle)


def _own_capture(run: Run | None, capture: Capture) -> Capture | None:
    """The capture that the avatar was trained on, if it is known, still there, and another than this."""
    if run is None or same_folder(run.capture, capture.path) or not run.capture.is_dir():
        return None
    return Capture.open(run.capture, cache_bytes=0)


def _reenact(
    avatar: DrivenHead, own: Capture, driver: Capture, figures: dict[str, Any], out: Path, console: Console
) -> Evaluation:
    """Drive the avatar by another person's capture, and print and write what can then be measured."""
    with console.status("driving the avatar by another person"), large_pieces():
        with ReenactmentRecorder(driver, out) as recorder:
            evaluation = reenactment.reenact(avatar, own, driver, observe=recorder)
        write_series(out / SERIES_FILE, {part.segment.name: part.series for part in evaluation.segments})
    why = {"hairstyle": {"reason": "the capture shows another person"}}
    write_json(out / METRICS, {**figures, **evaluation.to_json(), **why})
    console.print(reenactment_table(evaluation))
    console.print(
        Text(f"{evaluation.protocol['drive']}; expressions: {evaluation.protocol['expressions']}", style="dim")
    )
    for file in (out / METRICS, out / SERIES_FILE, *recorder.written):
        console.print(f"wrote {file}", highlight=False, soft_wrap=True)
    return evaluation


def _run_of(path: Path) -> Run | None:
    """The run, given its folder or that of the avatar inside; None for an avatar outside of its run."""
    owner = next((folder for folder in (path, path.resolve().parent) if (folder / "run.json").exists()), None)
    return None if owner is None else Run.open(owner)


def _stages_of_hair(run: Run) -> dict[str, Float[Tensor, "_ _ 3"]]:
    """The hairstyles that a run has kept."""
    canonical, first_guess = read_hair(run.canonical_hair), read_hair(run.first_guess)
    if canonical is None:
        return {}
    return {"canonical": canonical} if first_guess is None else {"first_guess": first_guess, "canonical": canonical}


def _evaluate_hairstyles(
    capture: Capture, hairstyles: Mapping[str, Float[Tensor, "_ _ 3"]], widths: Mapping[str, Float[Tensor, " _"]]
) -> HairstyleEvaluation:
    if not hairstyles:
        raise DynhairError("the method has no strands")
    return evaluate_hairstyles(capture, hairstyles, widths)


def _evaluate_motion(
    avatar: DrivenHead,
    capture: Capture,
    held_out: HeldOutViews,
    training: bool,
    appearance: Appearance | None,
    out: Path,
    console: Console,
) -> tuple[Evaluation, list[Path]]:
    segments = evaluated_segments(capture, training)
    total = sum(len(evaluated_indices(segment)) for segment in segments)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    bars = Progress(*columns, console=console, transient=True)
    with large_pieces(), bars as progress, Recorder(capture, out) as recorder:
        expressions = ExpressionSheet(capture, segments)
        task = progress.add_task("evaluating", total=total)

        def observe(frame: EvaluatedFrame) -> None:
            recorder(frame)
            expressions(frame)
            progress.update(task, advance=1, description=f"evaluating {frame.segment.name}")

        evaluation = evaluate_avatar(
            avatar, capture, held_out=held_out, appearance=appearance, observe=observe, training=training
        )
    series = out / SERIES_FILE
    write_series(series, {part.segment.name: part.series for part in evaluation.segments})
    sheet = expressions.write(out)
    return evaluation, [series, *recorder.written, *([] if sheet is None else [sheet])]
