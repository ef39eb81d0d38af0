"""Evaluations as tables for people."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from dynhair.evaluation.definitions import DEFINITIONS
from dynhair.evaluation.figures import Figures
from dynhair.evaluation.hairstyle import HairstyleEvaluation, HairstyleScores
from dynhair.evaluation.records import Evaluation, SegmentFigures

COLUMNS = {
    "psnr": ("PSNR", 2),
    "ssim": ("SSIM", 3),
    "hair_psnr": ("hair\nPSNR", 2),
    "hair_ssim": ("hair\nSSIM", 3),
    "hair_iou": ("hair\nIoU", 3),
    "hair_tiou": ("hair\ntIoU", 3),
    "hair_tiou_truth": ("truth\ntIoU", 3),
    "hair_tiou_still_truth": ("of it\nstill", 3),
    "hair_motion_explained": ("motion\nexpl.", 3),
}
HEAD_COLUMNS = {
    "hair_tlpips_excess": ("tLPIPS\nexcess", 4),
    "lpips": ("LPIPS", 3),
    "face_psnr": ("face\nPSNR", 2),
    "face_ssim": ("face\nSSIM", 3),
    "face_lpips": ("face\nLPIPS", 3),
    "boundary_psnr": ("edge\nPSNR", 2),
    "boundary_label_error": ("edge\nlabels", 3),
    "torso_motion": ("torso\nmotion", 2),
    "torso_motion_truth": ("truth\ntorso", 2),
}

LOOK_COLUMNS = {
    "lpips_vgg": ("LPIPS\nVGG", 3),
    "fid": ("FID", 1),
    "flip": ("FLIP", 3),
    "hair_lpips": ("hair\nLPIPS", 3),
    "hair_lpips_vgg": ("hair\nVGG", 3),
    "hair_fid": ("hair\nFID", 1),
    "tip_error_mm": ("tips\nmm", 1),
    "phase_lag_ms": ("lag\nms", 0),
}
MOTION_COLUMNS = {
    "hair_velocity": ("vel.\nm/s", 3),
    "hair_acceleration": ("acc.\nm/s2", 2),
    "ver": ("VER", 1),
    "cts": ("CTS\nmm", 3),
    "p95_disp": ("P95\nmm", 1),
    "amd": ("AMD", 1),
    "settling_s": ("settl.\ns", 2),
    "penetration_rate": ("inside\n%", 2),
    "stretch": ("stretch\n%", 2),
}
"""Headings and decimals."""

FACTORS = {"cts": 1e3, "p95_disp": 1e3, "penetration_rate": 100.0, "stretch": 100.0}
"""By which figures are multiplied, for the units of their headings."""

ALL_TEST_SEGMENTS = "all test"


def evaluation_table(evaluation: Evaluation) -> Group:
    """Tabulate all segments, head, looks and motion in those of the test, and say why figures are missing.

    The rigid hair is beneath the moving one, of a method that has both.
    """
    tests = [part for part in evaluation.segments if part.segment.split == "test"]
    whole = _table("segment", COLUMNS, evaluation.segments, evaluation)
    head = _table("head", HEAD_COLUMNS, tests, evaluation)
    looks = _table("hair, networks", LOOK_COLUMNS, tests, evaluation)
    motion = _table("motion", MOTION_COLUMNS, tests, evaluation, truth=True)
    return Group(whole, "", head, "", looks, "", motion, *_notes(evaluation))


def reenactment_table(evaluation: Evaluation) -> Group:
    """Tabulate the motion of hair that another person drives."""
    table = _table("cross-reenactment", MOTION_COLUMNS, evaluation.segments, evaluation)
    return Group(table, *_notes(evaluation, of=MOTION_COLUMNS))


def hairstyle_table(evaluation: HairstyleEvaluation) -> Group:
    """Tabulate the hair at rest, a column for each stage of its making, and say why figures are missing."""
    columns = list(evaluation.scores.values())
    table = Table(box=None, pad_edge=False, collapse_padding=True, header_style="bold")
    table.add_column("hair at rest", no_wrap=True)
    for name in evaluation.scores:
        table.add_column(name.replace("_", " "), justify="right", no_wrap=True)
    for kind, figures in (("seen", [c.seen for c in columns]), ("held out", [c.held_out for c in columns])):
        table.add_row(f"hair IoU, {figures[0].views} views {kind}", *(format_figure(f.iou, 3) for f in figures))
        table.add_row("  orientation error, degrees", *(format_figure(f.orientation_error, 2) for f in figures))
        table.add_row("  mean over pixels", *(str(f.orientation_pixels) for f in figures), style="dim")
    table.add_row("points inside head and body, %", *(format_figure(100 * c.inside, 3) for c in columns))
    for scores in zip(*(c.strands or () for c in columns), strict=True):
        label = f"strands {1e3 * scores[0].distance:g} mm, {scores[0].angle:g} deg: P / R / F"
        table.add_row(label, *(f"{s.precision:.3f} / {s.recall:.3f} / {s.f:.3f}" for s in scores))
    return Group(table, *_hairstyle_notes(columns[0]))


def _hairstyle_notes(scores: HairstyleScores) -> list[Text]:
    """Write a line for each figure that is missing; what is missing from one stage is missing from all."""
    reasons = {
        "IoU of held-out views: the capture has too few static views": not scores.held_out.views,
        "orientation error: no pixel is hair in both silhouettes with a confident direction": (
            not scores.seen.orientation_pixels
        ),
        "precision and recall of strands: the capture does not hold all true strands of this frame": (
            scores.strands is None
        ),
    }
    return [Text(f"n/a: {reason}", style="dim") for reason, missing in reasons.items() if missing]


def format_figure(value: float | None, decimals: int) -> str:
    """Print a figure, or ``n/a``; never a negative zero."""
    return "n/a" if value is None else f"{round(value, decimals) + 0.0:.{decimals}f}"


def _table(
    title: str,
    columns: Mapping[str, tuple[str, int]],
    parts: Sequence[SegmentFigures],
    evaluation: Evaluation,
    *,
    truth: bool = False,
) -> Table:
    """A row for each part and its rigid twin, and with ``truth`` one for the truth's own figures."""
    table = Table(box=None, pad_edge=False, collapse_padding=True, header_style="bold")
    table.add_column(title, no_wrap=True)
    table.add_column("hair", no_wrap=True)
    for heading, _ in columns.values():
        table.add_column(heading, justify="right", no_wrap=True)

    def cells(figures: Figures, suffix: str = "") -> list[str]:
        values = {key: figures.values.get(key + suffix) for key in columns}
        scaled = {key: None if value is None else FACTORS.get(key, 1.0) * value for key, value in values.items()}
        return [
            "" if key + suffix not in figures.values else format_figure(scaled[key], decimals)
            for key, (_, decimals) in columns.items()
        ]

    def add_rows(label: str, avatar: Figures, rigid: Figures | None, style: str = "") -> None:
        for name, hair, figures in ((label, "moving", avatar), ("", "rigid", rigid)):
            if figures is None:
                continue
            table.add_row(name, hair, *cells(figures), style=style if figures is avatar else "dim")
        if truth:
            table.add_row("", "truth", *cells(avatar, "_truth"), style="dim")

    for part in parts:
        add_rows(f"{part.segment.name} ({part.segment.split})", part.avatar, part.rigid)
    add_rows(ALL_TEST_SEGMENTS, evaluation.avatar, evaluation.rigid, style="bold")
    return table


def _notes(evaluation: Evaluation, of: Collection[str] = DEFINITIONS) -> list[Text]:
    """Write a line for each reason why any of these figures is missing, with the figures and segments concerned."""
    parts = [(part.segment.name, part.avatar) for part in evaluation.segments]
    missing: dict[str, tuple[dict[str, None], dict[str, None]]] = {}  # ordered sets of figures and segments
    for segment, figures in [*parts, (ALL_TEST_SEGMENTS, evaluation.avatar)]:
        for name, reason in ((name, reason) for name, reason in figures.reasons.items() if name in of):
            names, segments = missing.setdefault(reason, ({}, {}))
            names[name] = segments[segment] = None
    return [
        Text(f"n/a: {', '.join(names)} ({', '.join(segments)}): {reason}", style="dim")
        for reason, (names, segments) in missing.items()
    ]
