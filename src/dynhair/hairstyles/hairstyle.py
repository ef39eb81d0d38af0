"""A style's numbers to strands on a given head."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.errors import DynhairError
from dynhair.hairstyles.combing import comb
from dynhair.hairstyles.detail import add_detail
from dynhair.hairstyles.growth import grow_courses
from dynhair.hairstyles.head_field import HeadField
from dynhair.hairstyles.style import Style
from dynhair.hairstyles.trimming import grown_lengths, trimmed_lengths
from dynhair.strands.geometry import cut_strands, resample_strands, segment_lengths
from dynhair.strands.scalp_map import ScalpFrame

_DENSITY = 2
_CLEARANCE = 0.0022


@torch.no_grad()
def grow_hairstyle(
    style: Style,
    positions: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    frame: ScalpFrame,
    field: HeadField,
    points: int = 64,
) -> Float[Tensor, "n points 3"]:
    """Grow the strands of a style from given roots; each depends on its own root alone.

    Args:
        style: the hairstyle.
        positions: of the roots, head frame, metres.
        normals: of the scalp at the roots, unit, outwards.
        frame: of the scalp.
        field: of the same head.
        points: of each strand, at least 3; curls want more than waves.

    Returns:
        Strands in the head frame, metres, root first, outside of the head, with equal segments.

    Raises:
        DynhairError: fewer than 3 points.
    """
    if points < 3:
        raise DynhairError(f"a strand of {points} points has no shape", expected="at least 3 points")
    roots = frame.to_scalp(positions)
    combing = comb(style, roots, frame, field)
    courses = grow_courses(style, combing, positions, normals, grown_lengths(style, combing, roots), frame, field)
    lengths = trimmed_lengths(style, combing, courses, frame)
    courses = cut_strands(courses, lengths, _DENSITY * points)
    strands = add_detail(style, courses, lengths, roots, normals, frame.radius)
    strands = torch.cat([positions[:, None], strands[:, 1:]], dim=1)
    strands = resample_strands(_outside(strands, field), points)
    for _ in range(3):
        strands = _evenly_divided(_outside(strands, field))
    return strands


def _outside(strands: Tensor, field: HeadField) -> Tensor:
    travelled = functional.pad(segment_lengths(strands).cumsum(1), (1, 0))[:, 1:]
    clearance = (0.5 * travelled).clamp_max(_CLEARANCE)
    return torch.cat([strands[:, :1], field.push_out(strands[:, 1:], clearance)], dim=1)


def _evenly_divided(strands: Tensor) -> Tensor:
    """Every point moved to one and the same distance from the one before: follow the leader."""
    step = segment_lengths(strands).mean(1, keepdim=True)
    points = [strands[:, 0]]
    for point in strands.unbind(1)[1:]:
        points.append(points[-1] + step * functional.normalize(point - points[-1], dim=1))
    return torch.stack(points, dim=1)
