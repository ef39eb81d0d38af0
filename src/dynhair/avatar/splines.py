"""Splines along a strand, as matrices from its knots to its points."""

from __future__ import annotations

import torch
from jaxtyping import Float64, Int64
from torch import Tensor

from dynhair.errors import DynhairError


def evenly_spaced(points: int, knots: int) -> Int64[Tensor, " k"]:
    """Which of a strand's points are its knots, first and last among them; all if ``knots`` is 0 or not fewer.

    Raises:
        DynhairError: a single knot, or a negative number of them.
    """
    if knots < 0 or knots == 1:
        raise DynhairError(f"a strand with {knots} knots", expected="2 or more, or 0 for all its points")
    if knots == 0 or knots >= points:
        return torch.arange(points)
    return torch.linspace(0, points - 1, knots, dtype=torch.float64).round().long()


def natural_spline(knots: Int64[Tensor, " k"], points: int) -> Float64[Tensor, "l k"]:
    """The natural cubic spline: values at the knots to values at all points.

    Natural, for it keeps straightest: through samples of a trained network's displacements it came closer to the rest
    than a straight line or a spline with not-a-knot ends.

    Args:
        knots: ascending, the first 0 and the last ``points - 1``.
        points: points of a strand.

    Returns:
        One column for each knot; rows sum to one.
    """
    if len(knots) == points:
        return torch.eye(points, dtype=torch.float64)
    from scipy.interpolate import CubicSpline  # heavy, and networks without knots need none

    curves = CubicSpline(knots.numpy(), torch.eye(len(knots), dtype=torch.float64).numpy(), bc_type="natural")
    return torch.from_numpy(curves(torch.arange(points).numpy()))
