"""Plots of the head's motion over a take."""

from __future__ import annotations

import io
from collections.abc import Collection, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from dynhair.capture import HeadTrack
from dynhair.motion import motion_signals

_AXES = ("x", "y", "z")
_COLOURS = ("#d1495b", "#3a9d5d", "#3b6fb6")
_LOST = "#f2c14e"


def motion_plot(track: HeadTrack, first: int, lost: Collection[int]) -> str:
    """Plot position, rotation, angular velocity and angular acceleration over the frames of a segment, as SVG.

    Args:
        track: the head's pose.
        first: id of the first frame.
        lost: ids of frames in which no view showed the face; they are shaded.
    """
    signals = motion_signals(track)
    # about the mean rotation, as rotation vectors far from nought jump
    mean = Rotation.from_matrix(track.rotations).mean()
    turn = (Rotation.from_matrix(track.rotations) * mean.inv()).as_rotvec(degrees=True)
    curves = (
        ("position, cm from the mean", 100 * (track.translations - track.translations.mean(0))),
        ("rotation, degrees from the mean", turn),
        ("angular velocity, rad/s", signals.omega.numpy()),
        ("angular acceleration, rad/s²", signals.alpha.numpy()),
    )
    figure = Figure(figsize=(13, 2.4), layout="constrained")
    axes = figure.subplots(1, len(curves))
    frames = np.arange(first, first + len(track.rotations))
    for panel, (title, values) in zip(axes, curves, strict=True):
        _shade(panel, lost)
        for name, colour, column in zip(_AXES, _COLOURS, values.T, strict=True):
            panel.plot(frames, column, color=colour, label=name, linewidth=1.2)
        panel.set_title(title, fontsize=9)
    axes[0].legend(fontsize=7, loc="upper right", ncols=3, frameon=False)
    return _svg(figure)


def residual_plot(residuals: Float[np.ndarray, "f v"], names: Sequence[str], first: int) -> str:
    """Plot how far the landmarks of each view lie from the tracked head, as SVG.

    Args:
        residuals: median over the landmarks, pixels; NaN where a view did not show the face.
        names: of the cameras.
        first: id of the first frame.
    """
    figure = Figure(figsize=(13, 0.5 + 0.22 * len(names)), layout="constrained")
    panel = figure.subplots()
    span = (first - 0.5, first + len(residuals) - 0.5, len(names) - 0.5, -0.5)
    highest = float(np.nanpercentile(residuals, 98)) if np.isfinite(residuals).any() else 1.0
    shown = panel.imshow(
        residuals.T,
        aspect="auto",
        extent=span,
        vmin=0,
        vmax=max(highest, 1e-6),
        cmap="viridis",
        interpolation="nearest",
    )
    panel.set_facecolor("#dddddd")
    panel.set_yticks(range(len(names)), names, fontsize=7)
    panel.tick_params(axis="x", labelsize=7)
    figure.colorbar(shown, ax=panel, pad=0.01).ax.tick_params(labelsize=7)
    return _svg(figure)


def runs(frames: Collection[int]) -> list[tuple[int, int]]:
    """First and last of each run of consecutive frames."""
    ordered = sorted(frames)
    if not ordered:
        return []
    breaks = [(a, b) for a, b in pairwise(ordered) if b > a + 1]
    return list(zip([ordered[0], *(b for _, b in breaks)], [*(a for a, _ in breaks), ordered[-1]], strict=True))


def _shade(panel: Axes, lost: Collection[int]) -> None:
    for first, last in runs(lost):
        panel.axvspan(first - 0.5, last + 0.5, color=_LOST, alpha=0.35, linewidth=0)
    panel.grid(alpha=0.25)
    panel.tick_params(labelsize=7)


def _svg(figure: Figure) -> str:
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    text = file.getvalue()
    return text[text.index("<svg") :]
