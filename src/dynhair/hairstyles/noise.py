"""Random numbers that belong to places: hashes, smooth noise and clumps on the scalp.

A strand's peculiarities follow from where its root is and from the style's seed alone, so that a style can be sampled
at any set of roots and gives the same strand at the same root.
"""

from __future__ import annotations

from itertools import product

import torch
from jaxtyping import Float, Int
from torch import Tensor

_PRIMES = (73856093, 19349663, 83492791)
_MASK = (1 << 32) - 1
_GRAIN = 1e-4


def hashed(cells: Int[Tensor, "*n 3"], seed: int, channel: int = 0) -> Float[Tensor, "*n"]:
    """Uniform numbers in [0, 1) of integer lattice points; an integer mixer, the same on every platform."""
    x, y, z = cells.unbind(-1)
    mixed = (x * _PRIMES[0]) ^ (y * _PRIMES[1]) ^ (z * _PRIMES[2]) ^ (seed * 2654435761 + channel * 40503)
    for shift, factor in ((16, 0x45D9F3B), (15, 0x2C1B3C6D), (16, 1)):
        mixed = mixed & _MASK
        mixed = (mixed ^ (mixed >> shift)) * factor
    return ((mixed & _MASK) >> 8).to(torch.float32) / (1 << 24)


def strand_random(roots: Float[Tensor, "n 3"], seed: int, channel: int) -> Float[Tensor, " n"]:
    """Uniform numbers in [0, 1), independent between roots that are not at the same place.

    Args:
        roots: in scalp units.
        seed: the style's.
        channel: tells apart the numbers of one root.
    """
    return hashed((roots / _GRAIN).round().long(), seed, channel)


def smooth_noise(points: Float[Tensor, "n 3"], scale: float, seed: int, channel: int) -> Float[Tensor, " n"]:
    """Value noise in [-1, 1] that varies over distances of ``scale``."""
    places = points / scale
    corner = places.floor()
    share = places - corner
    share = share * share * (3 - 2 * share)
    corner = corner.long()
    total = torch.zeros_like(points[:, 0])
    for offset in product((0, 1), repeat=3):
        step = torch.tensor(offset)
        weight = torch.where(step.bool(), share, 1 - share).prod(-1)
        total = total + weight * hashed(corner + step, seed, channel)
    return 2 * total - 1


def clumps(
    points: Float[Tensor, "n 3"], size: float, seed: int, channel: int
) -> tuple[Float[Tensor, "n 3"], Int[Tensor, "n 3"]]:
    """The clump of each point: the nearest of the jittered points of a lattice's cells (Worley noise).

    Args:
        points: in scalp units.
        size: of a lattice cell, about the distance between clumps.
        seed: the style's.
        channel: tells apart several layers of clumps.

    Returns:
        The clumps' centres, and their cells, to be hashed for whatever a clump has in common.
    """
    steps = torch.tensor(list(product((-1, 0, 1), repeat=3)))
    cells = (points / size).floor().long()[:, None] + steps
    jitter = torch.stack([hashed(cells, seed, channel + axis) for axis in range(3)], dim=-1)
    centres = (cells + jitter) * size
    nearest = (centres - points[:, None]).square().sum(-1).argmin(1)
    rows = torch.arange(len(points))
    return centres[rows, nearest], cells[rows, nearest]
