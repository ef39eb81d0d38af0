"""The study's tables and plots."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from studies.hair_motion.fitting import ROWS
from studies.hair_motion.motions import ELEVEN, FPS, FRAMES
from studies.hair_motion.study import ceiling, results

from dynhair.storage import atomic_file

Results = Mapping[tuple[str, str, int], Sequence[Mapping[str, Any]]]
"""Results of all seeds by groom, row and number of motions."""


def write_page(folder: Path) -> None:
    """Write ``tables.md`` and ``growth.png`` of whatever has been fitted."""
    found: dict[tuple[str, str, int], list[Mapping[str, Any]]] = defaultdict(list)
    for result in results(folder):
        found[str(result["groom"]), str(result["row"]), int(str(result["motions"]))].append(result)
    grooms = sorted({groom for groom, _, _ in found})
    parts = [part for groom in grooms for part in (_ceiling(folder, groom), eleven_table(found, groom))]
    parts += [growth_table(found, groom) for groom in grooms]
    with atomic_file(folder / "tables.md") as temporary:
        temporary.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    figure = growth_figure(found, grooms)
    with atomic_file(folder / "growth.png") as temporary:
        figure.savefig(temporary, dpi=110)


def eleven_table(found: Results, groom: str) -> str:
    """Markdown: what each row explains after eleven motions."""
    unseen: list[str] = []
    lines = []
    for row in ROWS:
        runs = found.get((groom, row, len(ELEVEN)), [])
        if not runs:
            continue
        unseen = list(runs[0]["unseen"])
        figures = [_spread([float(np.mean(list(run["unseen"].values()))) for run in runs])]
        figures += [f"{np.mean([run['unseen'][name] for run in runs]):.2f}" for name in unseen]
        known = [run["validation"] for run in runs if run["validation"] is not None]
        learned = _spread([run["learned"] for run in runs])
        lines.append(f"| {row} | {learned} | {_spread(known) if known else ''} | {' | '.join(figures)} |")
    head = f"| {groom} hair, eleven motions | learned | validation | unseen | {' | '.join(unseen)} |"
    return "\n".join([head, "|---" * (4 + len(unseen)) + "|", *lines])


def growth_table(found: Results, groom: str) -> str:
    """Markdown: what is explained of unseen motions, by seconds learned from."""
    counts = sorted({count for kept, _, count in found if kept == groom})
    head = " | ".join(f"{count * FRAMES / FPS:g} s" for count in counts)
    lines = [f"| {groom} hair, unseen | {head} |", "|---" * (1 + len(counts)) + "|"]
    for row in ROWS:
        cells = [_unseen(found.get((groom, row, count), [])) for count in counts]
        if sum(bool(cell) for cell in cells) > 1:
            lines.append(f"| {row} | {' | '.join(_spread(cell) for cell in cells)} |")
    return "\n".join(lines)


def growth_figure(found: Results, grooms: Sequence[str]) -> Figure:
    """What is explained of unseen motions against seconds of training motion."""
    figure = Figure(figsize=(4.6 * max(1, len(grooms)), 3.6), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, max(1, len(grooms)), sharey=True))
    for panel, groom in zip(panels, grooms, strict=False):
        for row in ROWS:
            points = sorted(
                (count, _unseen(runs)) for (kept, name, count), runs in found.items() if (kept, name) == (groom, row)
            )
            if len(points) > 1:
                seconds = [count * FRAMES / FPS for count, _ in points]
                panel.plot(seconds, [np.mean(values) for _, values in points], marker="o", markersize=3, label=row)
        lengths = sorted({count * FRAMES / FPS for kept, _, count in found if kept == groom})
        panel.set(title=f"{groom} hair", xlabel="seconds of training motion", xscale="log")
        panel.set_xticks(lengths, [f"{length:g}" for length in lengths])
        panel.minorticks_off()
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("motion explained, unseen")
    if panels[0].get_legend_handles_labels()[0]:
        panels[0].legend(fontsize=8)
    return figure


def _ceiling(folder: Path, groom: str) -> str:
    found = ceiling(folder, groom)
    said = ", ".join(f"{value:.2f} of `{name}`" for name, value in found.items())
    return f"{groom} hair: a simulation that begins half a millimetre beside another explains {said}."


def _unseen(runs: Sequence[Mapping[str, Any]]) -> list[float]:
    return [float(np.mean(list(run["unseen"].values()))) for run in runs]


def _spread(values: Sequence[float]) -> str:
    if not values:
        return ""
    low, high = min(values), max(values)
    return f"{low:.3f}" if len(values) == 1 else f"{np.mean(values):.3f} ({low:.3f} to {high:.3f})"
