"""Plots over time, as SVG that takes its ink from the page around it."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

PANELS = {
    "tip_speed": "speed of the tips, m/s",
    "hair_tiou": "tIoU of the hair",
    "tip_error_mm": "error at the tips, mm",
}
"""Series that are plotted, one above the other, and their titles."""

COLOURS = ("#d1495b", "#3b82c4", "#3a9d5d", "#c58a1b", "#8e6bbf", "#2a9d9d", "#b8638f", "#7a8450")
"""Of the methods, in the order of the tables; legible on white and on near-black."""

_INK = "#010203"
"""Stands for the page's own ink until the SVG is written."""

Series = Mapping[str, Float[np.ndarray, " t"]]


@dataclass(frozen=True)
class Curve:
    """One method over one segment.

    Attributes:
        label: of the method.
        series: by name; ``time`` in seconds is among them.
        lag_ms: of its hair behind the truth's; None where it was not measured.
    """

    label: str
    series: Series
    lag_ms: float | None


def plot_segment(curves: Sequence[Curve], prefix: str) -> str:
    """Plot methods and truth over one segment, as SVG; empty where no curve has anything to plot.

    Args:
        curves: the methods, ours first.
        prefix: of the ids in the SVG, so that several can stand in one page.
    """
    names = [name for name in PANELS if any(_known(curve.series, name) for curve in curves)]
    if not names:
        return ""
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": prefix, "font.family": "sans-serif"}):
        figure = Figure(figsize=(9, 0.7 + 1.75 * len(names)), layout="constrained")
        figure.patch.set_alpha(0)
        panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for panel, name in zip(panels, names, strict=True):
            _draw(panel, name, curves)
        panels[-1].set_xlabel("time, s", fontsize=9, color=_INK)
        labelled = [panel.get_legend_handles_labels() for panel in panels]
        handles = {label: line for lines, labels in labelled for line, label in zip(lines, labels, strict=True)}
        figure.legend(
            handles.values(),
            handles.keys(),
            loc="outside upper center",
            ncols=min(4, len(handles)),
            fontsize=9,
            frameon=False,
            labelcolor=_INK,
        )
        return _svg(figure, prefix)


def _draw(panel: Axes, name: str, curves: Sequence[Curve]) -> None:
    for curve, colour in zip(curves, _cycled(len(curves)), strict=True):
        if _known(curve.series, name):
            lag = "" if curve.lag_ms is None else f" (lags by {curve.lag_ms:.0f} ms)"
            width = 2.0 if curve is curves[0] else 1.3
            panel.plot(curve.series["time"], curve.series[name], color=colour, linewidth=width, label=curve.label + lag)
    for curve in curves:
        if _known(curve.series, f"{name}_truth"):
            time, truth = curve.series["time"], curve.series[f"{name}_truth"]
            panel.plot(time, truth, color=_INK, linewidth=1.3, linestyle=(0, (4, 2)), label="truth")
            break
    panel.set_title(PANELS[name], fontsize=9, loc="left", color=_INK)
    panel.patch.set_alpha(0)
    panel.grid(alpha=0.18, color=_INK)
    panel.tick_params(labelsize=8, colors=_INK)
    panel.margins(x=0.01)
    for side, spine in panel.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(_INK)


def _known(series: Series, name: str) -> bool:
    return name in series and "time" in series and bool(np.isfinite(series[name]).any())


def _cycled(count: int) -> list[str]:
    return [COLOURS[index % len(COLOURS)] for index in range(count)]


def _svg(figure: Figure, prefix: str) -> str:
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    text = file.getvalue()
    text = text[text.index("<svg") :]
    # inside HTML no names of name spaces are needed, and ids are shared by the whole page
    text = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", text).replace("xlink:href", "href")
    text = re.sub(r'\bid="', f'id="{prefix}-', text)
    text = re.sub(r'(url\(|href=")#', rf"\1#{prefix}-", text)
    return text.replace(_INK, "currentColor")
