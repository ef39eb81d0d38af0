"""Points that cover others evenly, however many are taken."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64
from torch import Tensor


def farthest_points(points: Float[Tensor, "n 3"], count: int) -> Int64[Tensor, " c"]:
    """Farthest-point sampling (Gonzalez 1985): each point is the one farthest from those before it.

    What is chosen for a smaller count is the beginning of what is chosen for a larger one. The first point is the
    nearest to the mean; of points equally far, the first is taken.

    Args:
        points: to choose from.
        count: how many; all if there are fewer.

    Returns:
        Indices of different points, in the order in which they were chosen.
    """
    if not len(points):
        return torch.zeros(0, dtype=torch.long, device=points.device)
    places = points.detach().cpu().double()
    places = places - places.mean(0)
    squares = places.square().sum(1)
    chosen = [int(squares.argmin())]
    gaps = torch.full_like(squares, torch.inf)
    for _ in range(min(count, len(places)) - 1):
        last = places[chosen[-1]]
        torch.minimum(gaps, torch.addmv(squares, places, last, alpha=-2).add_(last @ last), out=gaps)
        gaps[chosen[-1]] = -1.0  # taken, so that of points in one place each is taken once
        chosen.append(int(gaps.argmax()))
    return torch.tensor(chosen[:count], dtype=torch.long, device=points.device)
