"""The page itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from dynhair.capture import Capture
from dynhair.capture.check import Finding
from dynhair.capture.records import Segment
from dynhair.preprocess.report.plots import motion_plot, residual_plot
from dynhair.preprocess.steps.step import Step
from dynhair.preprocess.steps.tracking import read_diagnostics
from dynhair.preprocess.workspace import Workspace
from dynhair.storage import atomic_file


def write_report(workspace: Workspace, steps: Sequence[Step], findings: Sequence[Finding]) -> Path:
    """Write ``preprocess/report.html``: warnings, contact sheets of all steps, and plots of the head's motion.

    Args:
        workspace: with a finished capture.
        steps: those that were taken, in order.
        findings: of the check of the capture.

    Returns:
        The page. Its pictures lie beside it.
    """
    capture = Capture.open(workspace.root)
    diagnostics = read_diagnostics(workspace)
    page = workspace.folder / "report.html"
    manifest = workspace.manifest
    takes = []
    for segment in manifest.segments:
        known = diagnostics["takes"][segment.name]
        residuals = np.array(known["residuals"], np.float64)  # None becomes NaN
        takes.append(
            {
                "name": segment.name,
                "motion": motion_plot(capture.track(segment), segment.start, known["lost"]),
                "residuals": residual_plot(residuals, manifest.camera_names, segment.start),
            }
        )
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    template = environment.from_string((files("dynhair.preprocess.report") / "page.html.jinja").read_text("utf-8"))
    width, height = manifest.image_size
    cameras = len(manifest.camera_names)
    facts = [
        f"{sum(segment.count for segment in manifest.segments)} frames of {cameras} camera{'s' if cameras > 1 else ''}",
        f"{manifest.fps:.4g} fps",
        f"{width} x {height} pixels",
    ]
    if workspace.static_names:
        facts.append(f"{len(workspace.static_names)} static views")
    text = template.render(
        name=workspace.root.resolve().name,
        facts=", ".join(facts),
        warnings=[_warning(raw) for raw in diagnostics["warnings"]],
        findings=findings,
        segments=[_segment_row(segment, diagnostics["takes"][segment.name]) for segment in manifest.segments],
        steps=[
            {"name": step.name, "title": step.title, "sheet": f"sheets/{step.sheet.name}", "note": step.note}
            for step in steps
            if step.sheet.exists()
        ],
        takes=takes,
        noise=_noise(diagnostics["noise"]),
    )
    with atomic_file(page) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return page


def _noise(raw: Mapping[str, float] | None) -> str:
    if raw is None:
        return ""
    return (
        f"Noise left in the tracked rotation: {raw['omega']:.3f} rad/s in angular velocity, {raw['alpha']:.2f} rad/s² "
        "in angular acceleration (root mean square, from the smoother's own covariance)."
    )


def _segment_row(segment: Segment, known: Mapping[str, Any]) -> dict[str, Any]:
    residuals = np.array(known["residuals"], np.float64)
    seen = np.isfinite(residuals).mean() if residuals.size else 0.0
    return {
        "name": segment.name,
        "split": segment.split,
        "count": segment.count,
        "start": segment.start,
        "seen": f"{100 * seen:.0f} %",
        "lost": len(known["lost"]),
    }


def _warning(raw: Mapping[str, Any]) -> dict[str, str]:
    parts = [f"camera {raw['camera']}" if raw["camera"] else "", raw["take"] or ""]
    if raw["frames"]:
        first, last = raw["frames"]
        parts.append(f"frame {first}" if first == last else f"frames {first} to {last}")
    return {"kind": raw["kind"], "text": raw["text"], "where": ", ".join(part for part in parts if part)}
