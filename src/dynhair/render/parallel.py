"""Cutting a rendering's work into pieces for several threads."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor

from dynhair.threads import thread_count

TILE_COST = 32  # of an empty tile, in list entries
MOST_SLICES = 8  # of a view: each has its own gradients of all splats, which must be cleared and added up


def slices_per_view(views: int) -> int:
    """Count the ranges to cut each view into, so that all threads have work."""
    return min(max(1, thread_count() // views), MOST_SLICES)


def share(count: int, parts: int) -> list[tuple[int, int]]:
    """Cut ``range(count)`` into contiguous ranges of about the same length."""
    return list(pairwise(count * part // parts for part in range(parts + 1)))


def share_tiles(starts: Tensor, parts: int) -> list[tuple[int, int]]:
    """Cut a view's tiles into contiguous ranges of about the same work."""
    if parts == 1:
        return [(0, len(starts) - 1)]
    work = starts.long() + TILE_COST * torch.arange(len(starts))
    cuts = torch.searchsorted(work, work[-1] * torch.arange(1, parts) // parts).tolist()
    return list(pairwise([0, *cuts, len(starts) - 1]))
