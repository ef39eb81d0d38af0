"""The search for the parametric hairstyle that looks most like the views of the hair at rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, fields

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
GENERATIONS = 7
POPULATION = 20
_ELITE = 5
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

    Each generation draws hairstyles from a normal distribution over the parameters, ranks their pictures, and moves
    the distribution to the best of them. The course of a groomed strand jumps with its parameters (a strand falls
    before or behind the shoulder), so that gradients would mislead.

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
    generator = torch.Generator().manual_seed(seed)
    least, most = torch.tensor(astuple(_LEAST)), torch.tensor(astuple(_MOST))
    mean, deviation = torch.full((len(fields(GroomParameters)),), 0.5), 0.35
    best, least_misfit = GroomParameters(), float("inf")
    spread = torch.full_like(mean, deviation)
    tried = 0
    for _ in range(GENERATIONS):
        draws = (mean + spread * torch.randn(POPULATION, len(mean), generator=generator)).clamp(0.0, 1.0)
        misfits = []
        for draw in draws:
            parameters = GroomParameters(*(least + draw * (most - least)).tolist())
            strands = grow_strands(parameters, roots, normals, obstacle, _POINTS, gravity)
            with torch.no_grad():
                misfits.append(misfit(render_hair(strands, width, body, views.cameras), views))
            if misfits[-1] < least_misfit:
                best, least_misfit = parameters, misfits[-1]
            tried += 1
            progress(tried, least_misfit)
        elite = draws[torch.tensor(misfits).argsort(stable=True)[:_ELITE]]
        mean = elite.mean(0)
        spread = 0.5 * spread + 0.5 * elite.std(0)
    return best


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
