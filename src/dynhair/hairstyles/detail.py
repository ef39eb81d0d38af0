"""What makes hair of courses: clumps, waves, curls and frizz."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.hairstyles.easing import smoothstep
from dynhair.hairstyles.noise import clumps, hashed, smooth_noise, strand_random
from dynhair.hairstyles.style import Style

_TAU = 2 * math.pi


def add_detail(
    style: Style,
    courses: Float[Tensor, "n m 3"],
    lengths: Float[Tensor, " n"],
    roots: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    radius: float,
) -> Float[Tensor, "n m 3"]:
    """Move the points of settled courses sideways, within each course's own parallel-transported frame.

    Args:
        style: the hairstyle.
        courses: points at equal arc steps, root first, metres.
        lengths: of the courses, metres.
        roots: in scalp units.
        normals: of the scalp at the roots, unit.
        radius: of the scalp, metres.
    """
    count = courses.shape[1]
    share = torch.linspace(0, 1, count)
    along = share * lengths[:, None]
    flat, upright = _frames(courses, normals)

    centres, cells = clumps(roots, style.clump_size, style.seed, 30)
    away = (roots - centres) * radius
    drawn = style.clumping * smoothstep(along / (0.35 * style.length + 0.02))
    across = -drawn * (away * flat[:, 0]).sum(1, keepdim=True)
    above = -drawn * (away * upright[:, 0]).sum(1, keepdim=True)

    waved = _waves(style, along, roots, cells)
    frizzed = _frizz(style, along, roots)
    across = across + waved[0] + frizzed[0]
    above = above + waved[1] + frizzed[1]
    return courses + across[..., None] * flat + above[..., None] * upright


def _waves(style: Style, along: Tensor, roots: Tensor, cells: Tensor) -> tuple[Tensor, Tensor]:
    common = 0.25 * smooth_noise(roots, 0.8, style.seed, 40)
    own = [2 * hashed(cells, style.seed, channel) - 1 for channel in (41, 42, 43, 44)]
    disorder = style.wave_disorder
    length = style.wave_length * (1 + 0.15 * common + 0.3 * disorder * own[0])
    amplitude = style.wave_amplitude * (1 + 0.25 * common + 0.4 * disorder * own[1])
    phase = _TAU * (common + 0.8 * disorder * own[2]) + 0.4 * (2 * strand_random(roots, style.seed, 45) - 1)
    # Curls of some clumps turn the other way.
    hand = torch.where(own[3] > 1 - 0.8 * disorder, -1.0, 1.0)
    angle = _TAU * (along - style.wave_start) / length[:, None] + phase[:, None]
    size = amplitude[:, None] * smoothstep(
        (along - 0.3 * style.wave_start) / (style.wave_start + 0.5 * style.wave_length)
    )
    return size * torch.cos(angle), size * style.curl * hand[:, None] * torch.sin(angle)


def _frizz(style: Style, along: Tensor, roots: Tensor) -> tuple[Tensor, Tensor]:
    stray = (strand_random(roots, style.seed, 50) < style.flyaways).float()
    size = style.frizz * (1 + 3 * stray)[:, None] * smoothstep(along / 0.08)
    offsets = []
    for axis in range(2):
        wave = torch.zeros_like(along)
        for part, base in enumerate((0.09, 0.04)):
            draw = [strand_random(roots, style.seed, 51 + 10 * axis + 3 * part + k)[:, None] for k in range(3)]
            wave = wave + draw[0] * torch.sin(_TAU * (along / (base * (0.7 + 0.6 * draw[1])) + draw[2]))
        offsets.append(size * wave)
    return offsets[0], offsets[1]


def _frames(courses: Tensor, normals: Tensor) -> tuple[Tensor, Tensor]:
    """Parallel-transported unit vectors across each course: along the scalp, and away from it, at the root."""
    tangents = functional.normalize(torch.gradient(courses, dim=1)[0], dim=-1)
    start = torch.linalg.cross(tangents[:, min(4, tangents.shape[1] - 1)], normals, dim=1)
    carried, current = [], start
    for tangent in tangents.unbind(1):
        current = functional.normalize(current - (current * tangent).sum(1, keepdim=True) * tangent, dim=1)
        carried.append(current)
    flat = torch.stack(carried, dim=1)
    return flat, torch.linalg.cross(flat, tangents, dim=-1)
