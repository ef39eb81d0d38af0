"""Where the static stage's strands begin: the strand prior's guess, a procedural style, or a groom from a file."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.hairstyles import HeadField, grow_hairstyle
from dynhair.prior.evidence import gather_evidence
from dynhair.prior.hair_prior import HairPrior
from dynhair.strands import resample_strands, texture_roots
from dynhair.strands.files import read_strands
from dynhair.strands.fitting import fit_to_scalp
from dynhair.training.rest_scene import RestScene
from dynhair.training.static_model import POINTS, EncodedHair
from dynhair.training.static_views import RestViews
from dynhair.training.style_search import misfit, search_style

_SEARCH_STRANDS = 200
_SEARCH_WIDTH = 1.2
_SEARCH_VIEWS = 8
_SEARCH_IMAGE = 96
_GROWN_POINTS = 100


def encoded_hair(scene: RestScene, prior: HairPrior, count: int, seed: int) -> EncodedHair:
    """Hair that a copy of the prior makes of the scene's views.

    Args:
        scene: the rest frame.
        prior: basis and encoders.
        count: strands.
        seed: of their roots.
    """
    views = scene.views
    evidence = gather_evidence(scene.frame, views.cameras, views.hair, views.direction, scene.body_depth)
    _, texels = texture_roots(scene.vertices, scene.faces, scene.scalp, scene.frame, prior.size)
    valid = torch.zeros(prior.size, prior.size, dtype=torch.bool)
    valid.view(-1)[texels] = True
    positions, _ = scene.roots(count, seed)
    return EncodedHair(copy.deepcopy(prior), evidence, valid, scene.frame, positions)


def grown_style(
    scene: RestScene, count: int, generations: int, seed: int, progress: Callable[[int, float], None]
) -> Float[Tensor, "n 200 3"]:
    """The procedural style that looks most like the scene's views, grown from as many roots as are wanted.

    Args:
        scene: the rest frame.
        count: strands.
        generations: of the search.
        seed: of roots and search.
        progress: called after each hairstyle tried with their number and the least misfit so far.
    """
    field = HeadField.of(scene.vertices, scene.faces)
    positions, normals = scene.roots(count, seed)
    few = min(_SEARCH_STRANDS, count)
    style, _ = search_style(
        positions[:few],
        normals[:few],
        scene.frame,
        field,
        scene.body,
        _few_views(scene),
        _SEARCH_WIDTH / few,
        generations=generations,
        seed=seed,
        progress=progress,
    )
    return resample_strands(grow_hairstyle(style, positions, normals, scene.frame, field, _GROWN_POINTS), POINTS)


def misfit_in_few_views(strands: Float[Tensor, "n l 3"], scene: RestScene, width: float) -> float:
    """The misfit of strands of some width, metres, with a few small views; see :func:`style_search.misfit`."""
    return misfit(strands, width, scene.body, _few_views(scene))


def _few_views(scene: RestScene) -> RestViews:
    chosen = torch.linspace(0, len(scene.views) - 1, min(_SEARCH_VIEWS, len(scene.views))).long().tolist()
    return scene.views[chosen].resized(_SEARCH_IMAGE)


def groom_from_file(path: Path, scene: RestScene, count: int, seed: int) -> Float[Tensor, "n 200 3"]:
    """The groom in a file, brought to this head, with ``count`` strands.

    A denser groom is thinned out at random; of a sparser one, roots drawn on the scalp take the nearest strand.

    Args:
        path: in one of the formats of :mod:`dynhair.strands.files`.
        scene: the rest frame.
        count: strands.
        seed: of the draws.

    Raises:
        DynhairError: the file is not readable, or its roots do not lie on a scalp like this one.
    """
    groom = read_strands(path).resampled(POINTS)
    fitted = fit_to_scalp(groom, scene.vertices, scene.faces, scene.scalp).strands
    if len(fitted) >= count:
        generator = torch.Generator().manual_seed(seed)
        return fitted[torch.randperm(len(fitted), generator=generator)[:count]]
    positions, _ = scene.roots(count, seed)
    nearest = torch.cdist(positions, fitted[:, 0]).argmin(1)
    return positions[:, None] + fitted[nearest] - fitted[nearest, :1]
