"""Curves of animation files: bases, widths for all or for each, and the transforms above them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError
from dynhair.strands.files.strand_file import StrandFile

_THROUGH_CONTROL_POINTS = ("linear", "catmullRom")


@dataclass(frozen=True)
class Curves:
    """The curves of one object.

    Attributes:
        points: control points of all curves, (P, 3).
        counts: control points of each, (N,).
        basis: "linear", "catmullRom", "bspline" or "bezier".
        widths: of the whole object (1,), of each curve (N,) or of each point (P,); others count as unknown.
        matrix: from the object to the scene, 4 x 4, for column vectors.
    """

    points: np.ndarray
    counts: np.ndarray
    basis: str
    widths: np.ndarray | None
    matrix: np.ndarray


def joined_curves(path: Path, objects: Sequence[Curves]) -> StrandFile:
    """The strands of all objects in the scene; their widths if those of all are known.

    Raises:
        DynhairError: there are none, or their numbers are impossible.
    """
    objects = [curves for curves in objects if len(curves.counts)]
    if not objects:
        raise DynhairError("there are no curves in it", path=path, mend="export the hair as curves, not as a mesh")
    for curves in objects:
        least, most, points = curves.counts.min(), curves.counts.max(), len(curves.points)
        if least < 1 or most > points or curves.counts.sum() != points:
            raise DynhairError(
                f"{len(curves.counts)} curves of {least} to {most} points are not their {points} points", path=path
            )
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused as such
            points = np.concatenate([_in_scene(curves) for curves in objects])
            widths = [_widths(curves) for curves in objects]
    except ValueError as error:
        raise DynhairError(str(error), path=path, expected="linear, Catmull-Rom, B-spline or Bezier curves") from None
    known = [each for each in widths if each is not None]
    return StrandFile.from_arrays(
        path,
        points,
        np.concatenate([curves.counts for curves in objects]),
        widths=np.concatenate(known) if len(known) == len(widths) else None,
    )


def _in_scene(curves: Curves) -> np.ndarray:
    points = on_curve(curves.points.astype(np.float64), curves.counts, curves.basis)
    return points @ curves.matrix[:3, :3].T + curves.matrix[:3, 3]


def _widths(curves: Curves) -> np.ndarray | None:
    if curves.widths is None or len(curves.widths) not in (1, len(curves.counts), len(curves.points)):
        return None
    widths = np.abs(np.linalg.det(curves.matrix[:3, :3])) ** (1 / 3) * curves.widths
    if len(widths) == len(curves.points):
        return widths
    return np.repeat(widths, curves.counts if len(widths) == len(curves.counts) else len(curves.points))


def on_curve(points: np.ndarray, counts: np.ndarray, basis: str) -> np.ndarray:
    """As many points on the curves as they have control points, at the same places along them.

    Args:
        points: control points of all curves, (P, 3).
        counts: control points of each.
        basis: "linear" or "catmullRom", whose control points lie on the curve; "bezier", cubic, where those between
            each third one are handles; "bspline", cubic and uniform, whose ends are taken to be clamped.

    Raises:
        ValueError: the basis is another, or a Bezier curve has not 3 n + 1 control points.
    """
    if basis in _THROUGH_CONTROL_POINTS:
        return points
    starts = np.cumsum(counts) - counts
    inner = np.ones(len(points), bool)
    inner[starts] = inner[starts + counts - 1] = False
    inner = np.flatnonzero(inner)
    found = points.astype(np.float64)
    if basis == "bspline":
        found[inner] = (points[inner - 1] + 4 * points[inner] + points[inner + 1]) / 6
        return found
    if basis != "bezier" or (counts % 3 != 1).any():
        raise ValueError(f"its curves are {basis} of {counts.min()} to {counts.max()} control points")
    place = np.arange(len(points)) - np.repeat(starts, counts)
    first = np.flatnonzero(place % 3 == 1)
    a, b, c, d = (points[first + step].astype(np.float64) for step in (-1, 0, 1, 2))
    found[first] = (8 * a + 12 * b + 6 * c + d) / 27
    found[first + 1] = (a + 6 * b + 12 * c + 8 * d) / 27
    return found
