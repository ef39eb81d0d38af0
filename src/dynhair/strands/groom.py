"""A parametric hairstyle: strands that leave the scalp, are combed away from a parting, and fall around the body.

A few numbers describe the style, so that a gradient-free search can fit them to pictures. It stands in the place of a
learned hair prior: it gives every strand, seen or unseen, a plausible course to start from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

_STEPS = 40
_CROWN_DEPTH = 0.06
_TAKE_OFF = 0.03


@runtime_checkable
class Obstacle(Protocol):
    """What strands must stay outside of, such as :class:`dynhair.strands.MeshDistance`."""

    def query(self, points: Float[Tensor, "p 3"]) -> tuple[Float[Tensor, " p"], Float[Tensor, "p 3"]]:
        """Signed distances (negative inside) and closest surface points, metres."""
        ...


@dataclass(frozen=True)
class GroomParameters:
    """A hairstyle in the head frame (x to the subject's left, y up, z out of the face); lengths are metres.

    Attributes:
        length: length of the longest strand.
        hem: how far below the highest root the hair is cut.
        parting: x of the parting; hair on either side of it is combed away from it.
        lift: height of the hair over skin.
        sweep: how much the front hair is combed backwards, against sideways (1: as much).
        fall: arc length over which the combing gives way to gravity.
        divide: how far in front of the roots' centre those strands start that fall before the shoulder.
        front: slope by which they lean forwards while they fall.
        back: slope by which the others lean backwards.
        flare: slope by which all lean away from the head's middle.
    """

    length: float = 0.5
    hem: float = 0.35
    parting: float = 0.0
    lift: float = 0.01
    sweep: float = 1.0
    fall: float = 0.08
    divide: float = 0.0
    front: float = 0.1
    back: float = 0.1
    flare: float = 0.05


def grow_strands(
    parameters: GroomParameters,
    roots: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    obstacle: Obstacle,
    points: int,
    gravity: Float[Tensor, "3"],
) -> Float[Tensor, "n points 3"]:
    """Grow a strand from each root.

    Each step goes on along a blend of the combed direction and gravity, is lifted off the obstacle, and is put back
    to the step's length; the course is then smoothed, cut at the hem and divided into equal segments.

    Args:
        parameters: the hairstyle.
        roots: on the scalp, head frame, metres.
        normals: unit, outwards.
        obstacle: head, neck and shoulders in the head frame.
        points: points of a strand, root first.
        gravity: its direction in the head frame, of any length.

    Returns:
        Strands in the head frame, metres; each has segments of equal length.
    """
    down = functional.normalize(gravity, dim=0)
    step = parameters.length / _STEPS
    combed, fallen = _directions(parameters, roots, normals, down)
    courses = [roots]
    for index in range(_STEPS):
        travelled = index * step
        yielded = _smoothstep(travelled / max(parameters.fall, 1e-6))
        leaving = max(0.0, 1.0 - travelled / _TAKE_OFF)
        direction = (1.0 - yielded) * combed + yielded * fallen + leaving * normals
        moved = courses[-1] + step * functional.normalize(direction, dim=1)
        moved = push_out(moved, obstacle, parameters.lift * min(1.0, (travelled + step) / _TAKE_OFF))
        courses.append(courses[-1] + step * functional.normalize(moved - courses[-1], dim=1))
    course = torch.stack(courses, dim=1)
    for _ in range(4):
        interior = 0.25 * course[:, :-2] + 0.5 * course[:, 1:-1] + 0.25 * course[:, 2:]
        course = torch.cat([course[:, :1], interior, course[:, -1:]], dim=1)
    return cut(course, hem_lengths(course, parameters.hem, down), points)


def hem_lengths(course: Float[Tensor, "n m 3"], hem: float, down: Float[Tensor, "3"]) -> Float[Tensor, " n"]:
    """Arc lengths at which strands first reach the hem, metres; the whole length of those that do not.

    Args:
        course: strands, root first, metres.
        hem: metres below the highest root.
        down: unit.
    """
    depth = course @ down
    below = depth - depth[:, 0].min() - hem
    arc = _arc_lengths(course)
    crossed = below[:, 1:] >= 0
    # argmax finds the first segment that crosses; a strand without one ends at its tip.
    first = torch.where(crossed.any(1), crossed.int().argmax(1), course.shape[1] - 2)[:, None]
    before, after = below.gather(1, first)[:, 0], below.gather(1, first + 1)[:, 0]
    share = (before / (before - after - 1e-9)).clamp(0.05, 1.0)
    share = torch.where(crossed.any(1), share, torch.ones_like(share))
    start, end = arc.gather(1, first)[:, 0], arc.gather(1, first + 1)[:, 0]
    return start + share * (end - start)


def cut(course: Float[Tensor, "n m 3"], lengths: Float[Tensor, " n"], points: int) -> Float[Tensor, "n points 3"]:
    """The first ``lengths`` metres of each strand in ``points - 1`` stretches of equal arc length."""
    arc = _arc_lengths(course)
    wanted = lengths[:, None] * torch.linspace(0.0, 1.0, points, dtype=course.dtype, device=course.device)
    upper = torch.searchsorted(arc, wanted.contiguous()).clamp(1, course.shape[1] - 1)
    low, high = arc.gather(1, upper - 1), arc.gather(1, upper)
    share = ((wanted - low) / (high - low).clamp_min(1e-12)).clamp(0.0, 1.0)[..., None]
    pick = upper[..., None].expand(-1, -1, 3)
    return (1 - share) * course.gather(1, pick - 1) + share * course.gather(1, pick)


def push_out(points: Float[Tensor, "p 3"], obstacle: Obstacle, clearance: float) -> Float[Tensor, "p 3"]:
    """Points moved straight away from the surface to at least ``clearance`` metres outside of the obstacle."""
    distance, closest = obstacle.query(points)
    # Inside, the direction from the closest point turns inwards.
    normal = functional.normalize((points - closest) * torch.where(distance < 0, -1.0, 1.0)[:, None], dim=1)
    return points + (clearance - distance).clamp_min(0.0)[:, None] * normal


def _arc_lengths(course: Tensor) -> Tensor:
    segments = (course[:, 1:] - course[:, :-1]).norm(dim=-1)
    return functional.pad(segments.cumsum(1), (1, 0))


def _directions(parameters: GroomParameters, roots: Tensor, normals: Tensor, down: Tensor) -> tuple[Tensor, Tensor]:
    """Where each strand is combed to, along the scalp, and where it falls."""
    # A clean parting: hair that belonged to neither side would fall over the face.
    side = torch.where(roots[:, 0] > parameters.parting, 1.0, -1.0)
    depth = roots[:, 2] - roots[:, 2].mean()
    crown = ((_CROWN_DEPTH / 2 - depth) / _CROWN_DEPTH).clamp(0.0, 1.0)[:, None]
    x = torch.tensor([1.0, 0.0, 0.0], dtype=roots.dtype, device=roots.device)
    z = torch.tensor([0.0, 0.0, 1.0], dtype=roots.dtype, device=roots.device)
    # Before the crown hair is combed sideways and backwards, behind it downwards.
    combed = (1 - crown) * (side[:, None] * x - parameters.sweep * z)
    combed = combed + crown * (down - z + 0.3 * side[:, None] * x)
    combed = functional.normalize(combed - (combed * normals).sum(1, keepdim=True) * normals, dim=1)
    before = (depth > parameters.divide)[:, None]
    leaning = torch.where(before, parameters.front * z, -parameters.back * z)
    outwards = functional.pad(roots[:, :1] - roots[:, :1].mean(), (0, 2)) / 0.07
    return combed, functional.normalize(down + leaning + parameters.flare * outwards, dim=1)


def _smoothstep(x: float) -> float:
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)
