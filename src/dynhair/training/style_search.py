"""The search for the procedural hairstyle that looks most like the views of the hair at rest.

The styles that the prior was learned from are a model of hair themselves: their numbers decide which way it is combed,
where it is cut, whether it falls before or behind the shoulders. Such choices cannot be made by gradients, for hair
jumps with them; where the encoders are in two minds about one they guess the mean of both, which is neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.hairstyles import FAMILIES, HeadField, Style, grow_hairstyle, random_style
from dynhair.losses import direction_loss
from dynhair.render import Gaussians
from dynhair.strands import ScalpFrame, resample_strands
from dynhair.training.static_scene import render_hair
from dynhair.training.static_views import RestViews

FIRST_DRAWS = 4
POPULATION = 16
_ELITE = 8
_SPREAD = 1.2
_LEAST_SPREAD = 0.02
_BOUND_DRAWS = 20
_POINTS = 24
_ORIENTATION = 0.5
# A number that is either 0 or 1, and one that only names a draw: they are inherited.
_INHERITED = frozenset({"tied", "seed"})


def search_length(generations: int) -> int:
    """How many hairstyles a search of so many generations after the first tries."""
    return len(FAMILIES) * FIRST_DRAWS + generations * POPULATION


def search_style(
    positions: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    frame: ScalpFrame,
    field: HeadField,
    body: Gaussians,
    views: RestViews,
    width: float,
    *,
    generations: int,
    seed: int,
    progress: Callable[[int, float], None],
) -> tuple[Style, float]:
    """Fit the numbers of a style by an evolution strategy, a gradient-free search.

    The first generation are draws from every family. Each later hairstyle is one of the best so far, its numbers moved
    by a little more than the spread of the best.

    Args:
        positions: of the roots, head frame, metres; a few hundred do.
        normals: of the scalp at the roots, unit.
        frame: of the scalp.
        field: of the head.
        body: opaque Gaussians of head and torso, without hair.
        views: what is looked at; few and small ones do.
        width: of a strand, metres.
        generations: after the first.
        seed: of the draws.
        progress: called after each hairstyle with the number tried and the least misfit so far.

    Returns:
        The best style tried, and its misfit.
    """
    generator = torch.Generator().manual_seed(seed)
    low, high = _bounds(seed)
    tried: list[Style] = []
    misfits: list[float] = []

    def rank(candidates: Sequence[Style]) -> list[Style]:
        for style in candidates:
            strands = grow_hairstyle(style, positions, normals, frame, field, _POINTS)
            tried.append(style)
            misfits.append(misfit(strands, width, body, views))
            progress(len(tried), min(misfits))
        best = torch.tensor(misfits).argsort(stable=True)[:_ELITE]
        return [tried[index] for index in best.tolist()]

    elite = rank(
        [random_style(family, seed * FIRST_DRAWS + draw) for family in FAMILIES for draw in range(FIRST_DRAWS)]
    )
    for _ in range(generations):
        numbers = torch.stack([_numbers(style) for style in elite])
        spread = _SPREAD * numbers.std(0) + _LEAST_SPREAD * (high - low)
        parents = torch.randint(len(elite), (POPULATION,), generator=generator)
        noise = torch.randn(POPULATION, len(low), generator=generator)
        children = (numbers[parents] + spread * noise).clamp(low, high)
        elite = rank(
            [_with_numbers(elite[parent], child) for parent, child in zip(parents.tolist(), children, strict=True)]
        )
    return elite[0], min(misfits)


@torch.no_grad()
def misfit(strands: Float[Tensor, "n l 3"], width: float, body: Gaussians, views: RestViews) -> float:
    """How unlike the views hair looks: 0 for the same, about 1 for no hair.

    The silhouettes' differing area over the hair's area, and half the mean squared sine of the angle between hair and
    orientation map where both are known.
    """
    images = render_hair(resample_strands(strands, _POINTS), width, body, views.cameras)
    area = (images.coverage - views.hair).abs().sum() / views.hair.sum().clamp_min(1.0)
    return float(area + _ORIENTATION * direction_loss(images.direction, images.coverage, views.direction))


def _searched() -> list[str]:
    return [field.name for field in fields(Style) if field.name not in _INHERITED]


def _numbers(style: Style) -> Float[Tensor, " k"]:
    return torch.tensor([float(getattr(style, name)) for name in _searched()])


def _with_numbers(style: Style, numbers: Float[Tensor, " k"]) -> Style:
    return replace(style, **dict(zip(_searched(), numbers.tolist(), strict=True)))


def _bounds(seed: int) -> tuple[Float[Tensor, " k"], Float[Tensor, " k"]]:
    """The least and the greatest of each number among styles of all families."""
    drawn = [_numbers(random_style(family, seed + draw)) for family in FAMILIES for draw in range(_BOUND_DRAWS)]
    return torch.stack(drawn).amin(0), torch.stack(drawn).amax(0)
