"""All of preprocessing, in order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rich.console import Console

from dynhair.capture import ExpressionBasis
from dynhair.capture.check import check_capture
from dynhair.face import face_model
from dynhair.preprocess.importing import import_step
from dynhair.preprocess.options import ImportOptions, PreprocessOptions
from dynhair.preprocess.report import write_report
from dynhair.preprocess.steps.hair import HairStep, TeachingStep
from dynhair.preprocess.steps.landmarks import LandmarkStep
from dynhair.preprocess.steps.matting import MattingStep
from dynhair.preprocess.steps.orientation import OrientationStep
from dynhair.preprocess.steps.steady import SteadyStep
from dynhair.preprocess.steps.step import Step
from dynhair.preprocess.steps.tracking import TrackingStep
from dynhair.preprocess.workspace import Workspace
from dynhair.progress import StageProgress
from dynhair.storage import write_json
from dynhair.threads import large_pieces


def preprocess(
    raw: Path | str,
    out: Path | str,
    importing: ImportOptions | None = None,
    options: PreprocessOptions | None = None,
    *,
    console: Console | None = None,
) -> Path:
    """Bring a recording to a capture that trains.

    Each step is skipped where its results are there and its inputs and settings are the same, so that an interrupted
    run goes on where it was. After each step there is a contact sheet, at the end a page that shows everything.

    Args:
        raw: the recording's folder.
        out: the capture's folder; new, empty, or begun before.
        importing: which frames, how large.
        options: how masks, hair masks and the head are found.
        console: where to show progress.

    Returns:
        The page: ``preprocess/report.html`` in the capture.

    Raises:
        DynhairError: the recording cannot be read, or what a method needs is not there.
    """
    options = options or PreprocessOptions()
    console = console or Console()
    options.check()
    model = face_model(options.face_model)
    workspace = Workspace(out)
    progress = StageProgress(console)

    def begin() -> None:
        workspace.layout.manifest.unlink(missing_ok=True)

    with large_pieces(), progress.shown():
        for note in import_step(Path(raw), workspace, importing or ImportOptions(), progress, begin):
            console.print(note, highlight=False, soft_wrap=True)
        hair = HairStep(workspace, options)
        steps: list[Step] = [MattingStep(workspace, options), *_steadying(workspace, options, "mask")]
        steps += [LandmarkStep(workspace)]
        steps += [TeachingStep(workspace, options)] if hair.method == "taught" else []
        steps += [hair, *_steadying(workspace, options, "hair")]
        steps += [OrientationStep(workspace), TrackingStep(workspace, options, model)]
        for step in steps:
            if step.run(progress, begin):
                console.print(f"{step.title}: {step.sheet}", highlight=False, soft_wrap=True)
    if not workspace.layout.manifest.exists():
        basis = ExpressionBasis(model.name, model.expression_names)
        write_json(workspace.layout.manifest, replace(workspace.manifest, expression_basis=basis).to_json())
    page = write_report(workspace, steps, check_capture(workspace.root, console=console))
    console.print(f"the capture: {workspace.root}\nwhat was found: {page}", highlight=False, soft_wrap=True)
    return page


def _steadying(workspace: Workspace, options: PreprocessOptions, kind: str) -> list[Step]:
    return [SteadyStep(workspace, kind)] if options.steady else []
