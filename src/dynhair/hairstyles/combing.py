"""Where hair is combed to: along the scalp, away from a parting, over the forehead, or to a tie."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.hairstyles.easing import smoothstep
from dynhair.hairstyles.head_field import HeadField
from dynhair.hairstyles.noise import smooth_noise, strand_random
from dynhair.hairstyles.style import Style
from dynhair.strands.scalp_map import ScalpFrame

CROWN = functional.normalize(torch.tensor([0.0, 0.85, -0.52]), dim=0)
_TIE_CLEARANCE = 0.014
_TAIL_SPREAD = 0.03
_JAW = -0.9


@dataclass(frozen=True)
class Combing:
    """What the hair of one style aims at, for each strand.

    Attributes:
        combed: direction in which the comb drew it, to be laid into the scalp's tangent plane.
        fall: direction in which it falls beside head and neck.
        side: -1 on the subject's right of the parting, 1 on the left.
        fringe: 1 where the root belongs to the fringe, else 0.
        tie: where its place in the tie is, metres.
        tail: direction in which it leaves the tie.
    """

    combed: Float[Tensor, "n 3"]
    fall: Float[Tensor, "n 3"]
    side: Float[Tensor, " n"]
    fringe: Float[Tensor, " n"]
    tie: Float[Tensor, "n 3"]
    tail: Float[Tensor, "n 3"]


def comb(style: Style, roots: Float[Tensor, "n 3"], frame: ScalpFrame, field: HeadField) -> Combing:
    """Comb every strand of a style.

    Args:
        style: the hairstyle.
        roots: in scalp units.
        frame: of the scalp.
        field: of the head, for where a tie lies.
    """
    x, _, z = roots.unbind(1)
    wobble = 0.03 * smooth_noise(roots, 0.25, style.seed, 1)
    clean = torch.where(x > style.parting + wobble, 1.0, -1.0)
    before = smoothstep((z - CROWN[2] - 0.1 * smooth_noise(roots, 0.5, style.seed, 2)) / 0.5)
    # A parting ends at the crown; behind it the sides pass into each other.
    side = before * clean + (1 - before) * torch.tanh(x / 0.25)

    # Front hair that has far to go past the face is combed over the top rather than along the forehead.
    far = (0.5 - x * side).clamp(0, 1.0) * smoothstep((z - 0.3) / 0.5)
    over = style.parted * far
    sideways = torch.stack([style.parted * side, over, -style.sweep - over], dim=1)
    away = _along(0, 0.1 * style.parted * x) + torch.tensor([0.0, -1.0, -0.5])
    combed = before[:, None] * sideways + (1 - before[:, None]) * away
    combed = (1 - style.whorl) * combed + style.whorl * -CROWN
    drift = torch.stack([smooth_noise(roots, 0.4, style.seed, channel) for channel in (3, 4, 5)], dim=1)
    combed = functional.normalize(combed + 0.12 * drift, dim=1)

    edge = 0.04 * smooth_noise(roots, 0.15, style.seed, 6)
    narrowing = (1 - smoothstep((style.fringe_depth + 0.45 - z) / 0.45) * 0.6) * style.fringe_width
    fringe = ((x.abs() + edge < narrowing) & (z + edge > style.fringe_depth) & (narrowing > 0)).float()
    forwards = torch.stack([0.25 * x + style.fringe_aside, -0.3 * torch.ones_like(x), torch.ones_like(x)], dim=1)
    combed = torch.where(fringe.bool()[:, None], functional.normalize(forwards, dim=1), combed)

    fall = functional.normalize(_along(0, style.flare * x) - torch.tensor([0.0, 1.0, 0.0]), dim=1)
    tie, outwards, spread = _tie(style, roots, frame, field)
    fall = functional.normalize(fall + 0.2 * style.tied * spread, dim=1)
    return Combing(combed, fall, clean, fringe, tie, outwards + spread)


def leaning(style: Style, here: Float[Tensor, "n 3"]) -> Float[Tensor, "n 1"]:
    """How much hair at places in scalp units leans forwards, to hang before the shoulders, or backwards."""
    _, y, z = here.split(1, dim=1)
    forward = torch.tanh((z - style.divide) / 0.12)
    # Hair is brought forward beside the ears already.
    slope = torch.where(forward > 0, style.front * lean_share(y - 0.6), style.back * lean_share(y))
    return slope * forward


def lean_share(heights: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    """How near to the shoulders a height is, scalp units: 0 beside the face, 1 below the jaw."""
    return smoothstep((_JAW + 0.6 - heights) / 0.6)


def _tie(style: Style, roots: Tensor, frame: ScalpFrame, field: HeadField) -> tuple[Tensor, Tensor, Tensor]:
    """Each strand's place in the tie, the way out of the head there, and how the strands spread in the tail."""
    direction = torch.tensor([style.tie_side, math.sin(style.tie_height), -math.cos(style.tie_height)])
    knot = frame.to_head(functional.normalize(direction, dim=0)[None])
    for _ in range(4):
        distance, normal = field.query(knot)
        knot = knot + (_TIE_CLEARANCE - distance)[:, None] * normal
    _, outwards = field.query(knot)
    # Strands from all around come to their own side of the bundle.
    spoke = roots - functional.normalize(direction, dim=0)
    spoke = functional.normalize(spoke - (spoke @ outwards[0])[:, None] * outwards, dim=1)
    radius = style.tie_radius * strand_random(roots, style.seed, 7).sqrt()
    return knot + radius[:, None] * spoke, outwards[0], (radius / _TAIL_SPREAD)[:, None] * spoke


def _along(axis: int, values: Tensor) -> Tensor:
    return functional.pad(values[:, None], (axis, 2 - axis))
