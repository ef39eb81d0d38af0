"""Strands' courses: grown step by step from the scalp, then settled on the body."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.hairstyles.combing import Combing, lean_share
from dynhair.hairstyles.head_field import HeadField
from dynhair.hairstyles.noise import strand_random
from dynhair.hairstyles.style import Style
from dynhair.strands.scalp_map import ScalpFrame

_STEPS = 56
_TAKE_OFF = 0.025
_SETTLING = 10
_SKIN = 0.002


def grow_courses(
    style: Style,
    combing: Combing,
    positions: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    lengths: Float[Tensor, " n"],
    frame: ScalpFrame,
    field: HeadField,
) -> Float[Tensor, "n m 3"]:
    """Let every strand run from its root as the comb leads it, yield to gravity, and lie on the body.

    A strand's distance from the head grows with the length that it has run: hair from above, which has come farther,
    lies over hair from below.

    Args:
        style: the hairstyle.
        combing: what each strand aims at.
        positions: of the roots, head frame, metres.
        normals: unit, outwards.
        lengths: to grow, metres.
        frame: of the scalp.
        field: of the body.
    """
    step = lengths / _STEPS
    roots = frame.to_scalp(positions)
    spread = 0.5 + strand_random(roots, style.seed, 10)
    travelled = torch.arange(_STEPS + 1) / _STEPS * lengths[:, None]
    clearance = _clearance(style, travelled, spread)
    free = combing.fringe[:, None] == 0
    keep = torch.exp(-step / style.stiffness)[:, None]
    tail_from = torch.full_like(lengths, math.inf if style.tied else -1.0)

    here, heading = positions, normals
    courses = [here]
    for index in range(_STEPS):
        distance, outwards = field.query(here)
        if style.tied:
            aim, tail_from = _tied(style, combing, here, outwards, travelled[:, index], tail_from, step)
            hug = tail_from.isinf().float()
        else:
            aim, hug = _combed(style, combing, frame.to_scalp(here), outwards, distance, travelled[:, index])
        rising = (style.lift * torch.exp(-travelled[:, index] / _TAKE_OFF))[:, None]
        aim = functional.normalize(aim, dim=1) + rising * normals
        heading = functional.normalize(keep * heading + (1 - keep) * functional.normalize(aim, dim=1), dim=1)
        moved = here + step[:, None] * heading
        distance, outwards = field.query(moved)
        target = clearance[:, index + 1]
        moved = moved + ((target - distance).clamp_min(0) - hug * (distance - target).clamp_min(0))[:, None] * outwards
        if not style.tied:
            moved = torch.where(free, _beside_the_face(style, combing, moved, step, frame), moved)
        heading = functional.normalize(moved - here, dim=1)
        here = here + step[:, None] * heading
        courses.append(here)
    return _settled(torch.stack(courses, dim=1), clearance, field)


def _clearance(style: Style, travelled: Tensor, spread: Tensor) -> Tensor:
    depth = style.thickness * spread[:, None] * (1 - torch.exp(-travelled / 0.1))
    return (travelled * 0.4).clamp_max(_SKIN) + depth


def _combed(
    style: Style, combing: Combing, here: Tensor, outwards: Tensor, distance: Tensor, travelled: Tensor
) -> tuple[Tensor, Tensor]:
    """The direction of a strand's next step, and how closely it keeps to the head."""
    touching = _smoothstep((style.thickness * 2 + 0.02 - distance) / 0.02)[:, None]
    flat = combing.combed - (combing.combed * outwards).sum(1, keepdim=True) * outwards
    flat = functional.normalize(flat, dim=1)
    combed = functional.normalize((1 - style.stand) * flat + style.stand * outwards, dim=1)
    falling = combing.fall + lean_share(here[:, 1:2]) * combing.lean
    inwards = (falling * outwards).sum(1, keepdim=True).clamp_max(0)
    falling = falling - touching * inwards * outwards
    # On a shoulder gravity no longer tells where to.
    falling = falling + (touching * -inwards * lean_share(here[:, 1:2])) * combing.lean.sign()
    yielded = _smoothstep(travelled / style.fall)[:, None]
    hug = (1 - yielded[:, 0]) * (1 - style.stand) * touching[:, 0]
    return (1 - yielded) * combed + yielded * falling, hug


def _tied(
    style: Style,
    combing: Combing,
    here: Tensor,
    outwards: Tensor,
    travelled: Tensor,
    tail_from: Tensor,
    step: Tensor,
) -> tuple[Tensor, Tensor]:
    """The direction of the next step of hair that runs to a tie and hangs from there; and where its tail began."""
    way = combing.tie - here
    left = way.norm(dim=1)
    tail_from = torch.where(tail_from.isinf() & (left < 1.5 * step + 0.004), travelled, tail_from)
    flat = way - (way * outwards).sum(1, keepdim=True) * outwards
    near = _smoothstep((0.06 - left) / 0.04)[:, None]
    flat = functional.normalize(near * way + (1 - near) * flat, dim=1)
    yielded = _smoothstep((travelled - tail_from).nan_to_num(0.0, 0.0, 0.0) / (2 * style.tail_stand))[:, None]
    hanging = (1 - yielded) * combing.tail + yielded * combing.fall
    return torch.where(tail_from.isinf()[:, None], flat, hanging), tail_from


def _beside_the_face(style: Style, combing: Combing, points: Tensor, step: Tensor, frame: ScalpFrame) -> Tensor:
    """Points moved sideways until they leave the face free, softly."""
    x, y, z = frame.to_scalp(points).unbind(1)
    width = style.opening * _smoothstep((0.45 - y) / 0.6) * _smoothstep((z - 0.4) / 0.35)
    missing = (width - x * combing.side).clamp_min(0) * frame.radius
    moved = points[:, 0] + combing.side * torch.minimum(missing, 0.6 * step)
    return torch.cat([moved[:, None], points[:, 1:]], dim=1)


def _settled(courses: Tensor, clearance: Tensor, field: HeadField) -> Tensor:
    """Even out kinks, without letting go of the body."""
    for _ in range(_SETTLING):
        inner = 0.25 * courses[:, :-2] + 0.5 * courses[:, 1:-1] + 0.25 * courses[:, 2:]
        courses = torch.cat([courses[:, :1], inner, courses[:, -1:]], dim=1)
        courses = torch.cat([courses[:, :1], field.push_out(courses[:, 1:], clearance[:, 1:])], dim=1)
    return courses


def _smoothstep(x: Tensor) -> Tensor:
    x = x.clamp(0, 1)
    return x * x * (3 - 2 * x)
