"""Validation of a whole capture."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from dynhair.capture.check.findings import Finding, grouped, print_findings
from dynhair.capture.check.frames import FrameFacts, TrackingChecker, mesh_faults
from dynhair.capture.check.sheet import contact_sheet
from dynhair.capture.check.views import ViewChecker, ViewJob
from dynhair.capture.layout import Layout, consecutive_runs, frame_ids, guess_manifest, view_names
from dynhair.capture.manifest import Manifest, manifest_problems, parse_manifest
from dynhair.capture.reader import Capture
from dynhair.capture.records import Segment, TrackedMesh
from dynhair.errors import DynhairError
from dynhair.storage import read_json


def run_check(path: Path | str, sheet: Path | None = None) -> int:
    """Check a capture and print what was found.

    Args:
        path: the capture's folder.
        sheet: where to write a contact sheet, if it can be opened; None for no sheet.

    Returns:
        The exit code: 1 if there are errors, else 0.
    """
    console = Console()
    findings = check_capture(path, console=console)
    print_findings(findings, console)
    try:
        capture = Capture.open(path)
    except DynhairError:
        return 1
    console.print(_summary(capture), highlight=False, soft_wrap=True)
    if sheet is not None:
        contact_sheet(capture, sheet)
        console.print(f"contact sheet: {sheet}", highlight=False)
    return int(any(finding.severity == "error" for finding in findings))


_NOTHING_TO_TRAIN_ON = Finding(
    "note",
    Path("capture.json"),
    "no segment has the split `train`: avatars can be evaluated on it and driven by it, not trained",
    "at least one, to train",
    "set `split` of a segment to train",
)


def check_capture(path: Path | str, *, console: Console | None = None) -> list[Finding]:
    """Validate everything in a capture: all files are read, all images decoded, in parallel.

    Args:
        path: the capture's folder.
        console: where to show progress; None shows none.

    Returns:
        What was found, the same fault of many files in one finding; empty for a sound capture.
    """
    layout = Layout(Path(path))
    findings: list[Finding] = []
    if not layout.root.is_dir():
        return [Finding("error", layout.root, "there is no such folder", "the folder of a capture")]
    manifest = _manifest(layout, findings)
    if manifest is None:
        return grouped(findings)
    manifest = _present(layout, manifest, findings)
    mesh = _mesh(layout, manifest, findings)
    _check_ground_truth(layout, manifest, findings)

    tracking = TrackingChecker(layout, manifest.segments, mesh, manifest.fps)
    frames = sum(segment.count for segment in manifest.segments)
    with _progress(console, frames * (1 + len(manifest.camera_names))) as advance:
        facts = tracking.run(advance)
        findings += tracking.findings
        _check_expression_basis(layout, manifest, facts, findings)
        jobs = [*_frame_jobs(layout, manifest, facts), *_static_jobs(layout, manifest, facts, findings)]
        kinds = tuple(kind for kind in ("hair", "orient") if layout.has_any(kind))
        check = ViewChecker(layout, manifest.image_size, kinds, manifest.background)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for done in as_completed([pool.submit(check, job) for job in jobs]):
                findings += done.result()
                advance()
    return grouped(findings)


def _manifest(layout: Layout, findings: list[Finding]) -> Manifest | None:
    """Read ``capture.json``; if it is not sound, take every frame there is by itself, to check the files at least."""
    if layout.manifest.exists():
        try:
            raw = read_json(layout.manifest)
            problems = manifest_problems(raw, layout.manifest)
            if not problems:
                manifest = parse_manifest(raw, layout.manifest)
                if all(segment.split != "train" for segment in manifest.segments):
                    findings.append(_NOTHING_TO_TRAIN_ON)
                return manifest
            findings += [Finding.from_error(problem, layout.root) for problem in problems]
        except DynhairError as error:
            findings.append(Finding.from_error(error, layout.root))
    try:
        guess = guess_manifest(layout)
    except DynhairError as error:
        findings.append(Finding.from_error(error, layout.root))
        return None
    if layout.manifest.exists():
        frames = [frame for segment in guess.segments for frame in segment.frames]
        return replace(guess, segments=tuple(Segment(str(frame), frame, 1, "train") for frame in frames))
    findings.append(
        Finding(
            "note",
            Path("capture.json"),
            f"there is none: read as a folder for Gaussian Head Avatar, {guess.fps:g} fps, all frames for training",
            "fps, segments with their splits, and the background",
            "write one, so that a motion can be held out and the hair's speed is right",
        )
    )
    return guess


def _present(layout: Layout, manifest: Manifest, findings: list[Finding]) -> Manifest:
    """Compare segments and cameras with the folders, and go on with the frames that are there."""
    present = set(frame_ids(layout.images))
    segments: list[Segment] = []
    for segment in manifest.segments:
        there = [frame for frame in segment.frames if frame in present]
        missing = [frame for frame in segment.frames if frame not in present]
        if missing:
            findings.append(
                Finding(
                    "error",
                    layout.frame_images(missing[0]).relative_to(layout.root),
                    f"segment `{segment.name}` names {len(missing)} frames that have no images",
                    f"a folder for each of frames {segment.start} to {segment.start + segment.count - 1}",
                    "mend `start` and `count` of the segment, or add the frames",
                )
            )
        for run in consecutive_runs(there):
            segments.append(replace(segment, start=run[0], count=len(run)))
    extra = present - {frame for segment in manifest.segments for frame in segment.frames}
    if extra:
        findings.append(
            Finding(
                "note",
                layout.frame_images(min(extra)).relative_to(layout.root),
                f"{len(extra)} frames belong to no segment",
                mend="nothing, if they are to be left out",
            )
        )
    return replace(manifest, segments=tuple(segments))


def _mesh(layout: Layout, manifest: Manifest, findings: list[Finding]) -> TrackedMesh | None:
    try:
        mesh = Capture(layout, manifest).mesh
    except DynhairError as error:
        findings.append(Finding.from_error(error, layout.root))
        return None
    if mesh is not None:
        findings += mesh_faults(mesh, layout.mesh.relative_to(layout.root))
    return mesh


def _check_ground_truth(layout: Layout, manifest: Manifest, findings: list[Finding]) -> None:
    capture = Capture(layout, manifest)
    for segment in manifest.segments:
        try:
            capture.ground_truth(segment)
        except DynhairError as error:
            findings.append(Finding.from_error(error, layout.root))


def _check_expression_basis(
    layout: Layout, manifest: Manifest, facts: dict[int, FrameFacts], findings: list[Finding]
) -> None:
    counts = {known.expression_count for known in facts.values() if known.expression_count is not None}
    if manifest.expression_basis is None or len(counts) != 1:  # frames that differ are a fault of their own
        return
    try:
        manifest.expression_basis.require_size(counts.pop(), layout.manifest)
    except DynhairError as error:
        findings.append(Finding.from_error(error, layout.root))


def _frame_jobs(layout: Layout, manifest: Manifest, facts: dict[int, FrameFacts]) -> Iterator[ViewJob]:
    for frame, known in facts.items():
        for name in manifest.camera_names:
            yield ViewJob(
                layout.frame_images(frame),
                name,
                layout.camera(frame, name),
                known.head,
                layout.landmarks_2d(frame, name),
            )


def _static_jobs(
    layout: Layout, manifest: Manifest, facts: dict[int, FrameFacts], findings: list[Finding]
) -> Iterator[ViewJob]:
    names = sorted(view_names(layout.static_images))
    frame = manifest.static_frame
    if frame is None and manifest.segments:
        frame = manifest.segments[0].start
    head = facts[frame].head if frame in facts else None
    if names and head is None:
        findings.append(
            Finding(
                "error",
                layout.manifest.relative_to(layout.root),
                f"the static views show frame {frame}, whose head pose is not known",
                "the id of a frame in a segment",
                "mend `frame` in `static360`",
            )
        )
    for name in names:
        yield ViewJob(layout.static_images, name, layout.static_camera(name), head)


@contextmanager
def _progress(console: Console | None, total: int) -> Iterator[Callable[[], None]]:
    """Yield a function to call after each of ``total`` steps."""
    columns = (TextColumn("checking"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=console is None) as progress:
        task = progress.add_task("", total=total)
        yield lambda: progress.advance(task)


def _summary(capture: Capture) -> str:
    frames = sum(segment.count for segment in capture.segments)
    held_out = sum(segment.split == "test" for segment in capture.segments)
    width, height = capture.image_size
    parts = [
        f"{frames:,} frames in {len(capture.segments)} segments ({held_out} held out)",
        f"{len(capture.camera_names)} views of {width} x {height} at {capture.fps:g} fps",
    ]
    if capture.static_names:
        parts.append(f"{len(capture.static_names)} static views")
    if capture.mesh is not None:
        parts.append(f"mesh of {len(capture.mesh.follow):,} vertices")
    parts.append(_expressions(capture))
    parts += [
        label
        for kind, label in (("hair", "hair masks"), ("orient", "orientation maps"))
        if capture.layout.has_any(kind)
    ]
    return f"{capture.name}: " + ", ".join(parts)


def _expressions(capture: Capture) -> str:
    basis = capture.expression_basis
    model = "a face model that is not named" if basis is None else f"the face model `{basis.name}`"
    try:
        track = capture.track(replace(capture.segments[0], count=1))
    except DynhairError:  # is among the findings
        return f"expressions of {model}"
    return f"{track.expressions.shape[1]} expression coefficients of {model}"
