"""Strands' courses: grown step by step from the scalp, then settled on the body."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.hairstyles.combing import Combing, lean_share, leaning
from dynhair.hairstyles.easing import smoothstep
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
        away = (target - distance).clamp_min(0) - hug * (distance - target).clamp_min(0)
        moved = moved + away[:, None] * _across_shoulders(outwards, frame.to_scalp(moved))
        if not style.tied and style.opening > 0:
            moved = torch.where(free, _beside_the_face(style, combing, moved, step, frame), moved)
        heading = functional.normalize(moved - here, dim=1)
        here = here + step[:, None] * heading
        courses.append(here)
    return _settled(torch.stack(courses, dim=1), clearance, frame, field)


def _clearance(style: Style, travelled: Tensor, spread: Tensor) -> Tensor:
    depth = style.thickness * spread[:, None] * (1 - torch.exp(-travelled / 0.1))
    return (travelled * 0.4).clamp_max(_SKIN) + depth


def _combed(
    style: Style, combing: Combing, here: Tensor, outwards: Tensor, distance: Tensor, travelled: Tensor
) -> tuple[Tensor, Tensor]:
    """The direction of a strand's next step, and how closely it keeps to the head."""
    touching = smoothstep((style.thickness * 2 + 0.02 - distance) / 0.02)[:, None]
    flat = combing.combed - (combing.combed * outwards).sum(1, keepdim=True) * outwards
    combed = (1 - style.stand) * flat + style.stand * outwards
    lean = leaning(style, here) * (here.new_tensor([0.0, 0.0, 1.0]))
    # Hair that has come down on one side of a shoulder stays there.
    astray = touching * lean_share(here[:, 1:2]) * (outwards[:, 2:] * lean[:, 2:] < -0.05).float()
    falling = combing.fall + (1 - astray) * lean
    inwards = (falling * outwards).sum(1, keepdim=True).clamp_max(0)
    falling = falling - touching * inwards * outwards
    # A shoulder bears the hair up: it slides off before or behind it, not along the arm.
    resting = (2 * touching * -inwards * lean_share(here[:, 1:2])).clamp_max(1)
    slope = functional.normalize(outwards * outwards.new_tensor([0.0, 1.0, 1.0]), dim=1)
    sliding = slope[:, 1:2] * slope - torch.tensor([0.0, 1.0, 0.0])
    sliding = functional.normalize(sliding + 0.3 * (1 - astray) * lean.sign(), dim=1)
    falling = (1 - resting) * falling + resting * sliding
    # Hair that was combed uphill or past the face lies on hair that bears it, until it is over the top.
    above = outwards[:, 1] + 0.4 * here[:, 2]
    uphill = smoothstep(-(flat * falling).sum(1) / 0.2) * smoothstep((above - 0.1) / 0.3)
    facing = smoothstep((style.opening + 0.1 - here[:, 0] * combing.side) / 0.3) * smoothstep((here[:, 2] - 0.35) / 0.3)
    on_scalp = touching * smoothstep((here[:, 1:2] + 0.4) / 0.4)
    borne = on_scalp * torch.maximum(uphill, facing * (style.opening > 0))[:, None] * (1 - style.stand)
    yielded = smoothstep(travelled / style.fall)[:, None] * (1 - borne)
    hug = (1 - yielded[:, 0]) * touching[:, 0] * max(0.0, 1 - 2 * style.stand)
    # Some gravity from the start: where the comb pointed away from the scalp, its direction along it means nothing.
    return (1 - yielded) * combed + (yielded + 0.15 * (1 - yielded) * (1 - borne)) * falling, hug


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
    near = smoothstep((0.06 - left) / 0.04)[:, None]
    flat = functional.normalize(near * way + (1 - near) * flat, dim=1)
    yielded = smoothstep((travelled - tail_from).nan_to_num(0.0, 0.0, 0.0) / (2 * style.tail_stand))[:, None]
    hanging = (1 - yielded) * combing.tail + yielded * combing.fall
    return torch.where(tail_from.isinf()[:, None], flat, hanging), tail_from


def _beside_the_face(style: Style, combing: Combing, points: Tensor, step: Tensor, frame: ScalpFrame) -> Tensor:
    """Points moved sideways until they leave the face free, softly."""
    x, y, z = frame.to_scalp(points).unbind(1)
    before = smoothstep((0.7 - y) / 0.6) * smoothstep((z - 0.35) / 0.35)
    width = style.opening + 0.6 * (z - 0.6).clamp_min(0)
    missing = before * (width * before - x * combing.side).clamp_min(0) * frame.radius
    way = torch.stack([combing.side, torch.zeros_like(x), torch.full_like(x, -0.7)], dim=1)
    return points + torch.minimum(missing, 0.4 * step)[:, None] * way


def _across_shoulders(outwards: Tensor, here: Tensor) -> Tensor:
    """Ways out of the body that, below the jaw, do not lead out along the arms."""
    sideways = 1 - 0.8 * lean_share(here[..., 1:2])
    damped = outwards * torch.cat([sideways, torch.ones_like(here[..., 1:])], dim=-1)
    return damped / (damped * outwards).sum(-1, keepdim=True).clamp_min(0.3)


def _settled(courses: Tensor, clearance: Tensor, frame: ScalpFrame, field: HeadField) -> Tensor:
    """Even out kinks, without letting go of the body."""
    for _ in range(_SETTLING):
        inner = 0.25 * courses[:, :-2] + 0.5 * courses[:, 1:-1] + 0.25 * courses[:, 2:]
        courses = torch.cat([courses[:, :1], inner, courses[:, -1:]], dim=1)
        distance, outwards = field.query(courses[:, 1:])
        away = (clearance[:, 1:] - distance).clamp_min(0)[..., None] * _across_shoulders(
            outwards, frame.to_scalp(courses[:, 1:])
        )
        courses = torch.cat([courses[:, :1], courses[:, 1:] + away], dim=1)
    return courses
