"""The search for the parametric hairstyle that looks most like the views of the hair at rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.render import Gaussians
from dynhair.strands import MeshDistance
from dynhair.strands.groom import GroomParameters, grow_strands
from dynhair.training.static_scene import HairImages, render_hair
from dynhair.training.static_views import RestViews

_LEAST = GroomParameters(
    length=0.08, hem=0.08, parting=-0.05, lift=0.002, sweep=-0.5, fall=0.01, divide=-0.06, front=-0.1, back=-0.1,
    flare=-0.1,
)  # fmt: skip
_MOST = GroomParameters(
    length=0.7, hem=0.6, parting=0.05, lift=0.025, sweep=3.0, fall=0.15, divide=0.08, front=0.4, back=0.5, flare=0.4
)
GENERATIONS = 18
POPULATION = 12
FIRST_POPULATION = 60
_ELITE = 6
_SPREAD = 1.2
_POINTS = 20
_ORIENTATION = 0.5


def search_groom(
    roots: Float[Tensor, "n 3"],
    normals: Float[Tensor, "n 3"],
    obstacle: MeshDistance,
    gravity: Float[Tensor, "3"],
    body: Gaussians,
    views: RestViews,
    width: float,
    *,
    seed: int,
    progress: Callable[[int, float], None],
) -> GroomParameters:
    """Fit the groom by the cross-entropy method, a gradient-free search.

    The first generation covers the parameters evenly. Each later one is drawn from a normal distribution with the mean
    and a little more than the spread of the best hairstyles so far, by the likeness of their pictures. The course of a
    groomed strand jumps with its parameters (a strand falls before or behind the shoulder): gradients would mislead.

    Args:
        roots: head frame, metres.
        normals: of the scalp at the roots, unit.
        obstacle: head and torso in the head frame.
        gravity: its direction in the head frame.
        body: opaque Gaussians of head and torso, without hair.
        views: what is looked at; few and small ones do.
        width: of a strand, metres.
        seed: of the draws.
        progress: called after each hairstyle with the number tried and the least misfit so far.

    Returns:
        The best hairstyle tried.
    """
    least, most = torch.tensor(astuple(_LEAST)), torch.tensor(astuple(_MOST))
    draws: list[Tensor] = []
    misfits: list[float] = []

    def parameters(draw: Tensor) -> GroomParameters:
        return GroomParameters(*(least + draw * (most - least)).tolist())

    def rank(candidates: Tensor) -> Tensor:
        for draw in candidates:
            strands = grow_strands(parameters(draw), roots, normals, obstacle, _POINTS, gravity)
            with torch.no_grad():
                misfits.append(misfit(render_hair(strands, width, body, views.cameras), views))
            draws.append(draw)
            progress(len(draws), min(misfits))
        best = torch.tensor(misfits).argsort(stable=True)[:_ELITE]
        return torch.stack([draws[index] for index in best.tolist()])

    generator = torch.Generator().manual_seed(seed)
    elite = rank(torch.quasirandom.SobolEngine(len(least), scramble=True, seed=seed).draw(FIRST_POPULATION))
    for _ in range(GENERATIONS):
        noise = torch.randn(POPULATION, len(least), generator=generator)
        drawn = elite.mean(0) + _SPREAD * elite.std(0) * noise
        # Mirrored at the bounds rather than clamped, which would heap the draws there.
        elite = rank(1 - (1 - drawn.abs()).abs().clamp_max(1))
    return parameters(elite[0])


def misfit(images: HairImages, views: RestViews) -> float:
    """How unlike the views the hair looks: 0 for the same, about 1 for no hair.

    The silhouettes' differing area over the hair's area, and half the mean squared sine of the angle between hair and
    orientation map where both are known.
    """
    area = (images.coverage - views.hair).abs().sum() / views.hair.sum().clamp_min(1.0)
    return float(area + _ORIENTATION * orientation_error(images, views))


def orientation_error(images: HairImages, views: RestViews) -> Float[Tensor, ""]:
    """Mean squared sine of the angle between the hair and the orientation maps, weighted by coherence.

    It is ``(1 - cos 2d) / 2`` for angles that differ by ``d``: undirected, smooth everywhere, without decoding angles.
    """
    weight = views.direction.norm(dim=-1) * images.coverage.detach()
    target = torch.nn.functional.normalize(views.direction, dim=-1)
    agreement = (images.direction * target).sum(-1) / (images.coverage + 1e-3)
    return (weight * (1 - agreement)).sum() / (2 * weight.sum().clamp_min(1.0))
