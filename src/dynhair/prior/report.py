"""How good a prior is: errors on hairstyles that it was not trained on, as figures, curves and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor
from torch.nn import functional

from dynhair.hairstyles import random_head
from dynhair.pictures import Picture, grid
from dynhair.prior.basis import normal_form
from dynhair.prior.basis_report import plot_reconstruction, reconstruction_errors
from dynhair.prior.dataset import FRONT_VIEWS, RING_VIEWS, TEXTURE, StyleViews
from dynhair.prior.disturbance import Maps
from dynhair.prior.hair_prior import HairPrior
from dynhair.prior.training import Target, decoded
from dynhair.render import Gaussians, rasterize
from dynhair.storage import atomic_file, write_json
from dynhair.strands import strand_gaussians, strands_and_body
from dynhair.strands.scalp import smooth_surface
from dynhair.strands.scalp_map import texture_roots
from dynhair.training.static_scene import surface_gaussians

VIEWS: dict[int, list[int]] = {
    FRONT_VIEWS + len(ring): [*range(FRONT_VIEWS), *ring]
    for ring in (range(FRONT_VIEWS, FRONT_VIEWS + RING_VIEWS, step) for step in (1, 2, 6))
} | {FRONT_VIEWS: list(range(FRONT_VIEWS))}
"""The views that a prior is judged with, by their number: those in front, with more and more of the ring."""

_POINTS = 24
_PICTURED_WIDTH = 0.0025
_COLOURS = {"mean hairstyle": "#888888", "coarse": "#d1495b", "coarse and fine": "#3b6fb6"}


@dataclass(frozen=True)
class EncoderError:
    """Mean distance of corresponding points, millimetres, over the hairstyles of a family.

    Attributes:
        family: of hairstyles.
        views: how many the prior saw.
        mean_hairstyle: of the mean hairstyle, which needs no view.
        coarse: of the coarse network alone.
        fine: of both.
    """

    family: str
    views: int
    mean_hairstyle: float
    coarse: float
    fine: float


@torch.no_grad()
def encoder_errors(prior: HairPrior, styles: Sequence[StyleViews], views: Sequence[int]) -> list[EncoderError]:
    """Judge a prior on undisturbed views, family by family.

    Args:
        prior: what is judged.
        styles: that it was not trained on.
        views: their numbers, see :data:`VIEWS`.
    """
    errors = []
    for count in views:
        found: dict[str, list[tuple[float, float, float]]] = {}
        for style in styles:
            coarse, *_, fine = prior.coarse_to_fine(Maps.of(style, VIEWS[count]).evidence())
            distances = [_distance(prior, texture, style) for texture in (prior.mean, coarse, fine)]
            found.setdefault(style.family, []).append((distances[0], distances[1], distances[2]))
        for family, rows in found.items():
            errors.append(EncoderError(family, count, *np.mean(rows, axis=0).tolist()))
    return errors


def write_report(
    folder: Path,
    prior: HairPrior,
    styles: Mapping[str, Sequence[StyleViews]],
    course: Sequence[Mapping[str, float | int]],
    progress: Callable[[str], None] = lambda part: None,
) -> dict[str, Any]:
    """Write ``report.json``, three plots and a sheet of hairstyles.

    Args:
        folder: for the report.
        prior: what is judged.
        styles: by the name of their set.
        course: of the training.
        progress: called with the name of each part before it is made.

    Returns:
        What ``report.json`` holds.
    """
    folder.mkdir(parents=True, exist_ok=True)
    progress("basis")
    radius = float(np.mean([style.frame.radius for some in styles.values() for style in some]))
    strands = {name: _normal_strands(some) for name, some in styles.items()}
    rebuilt = reconstruction_errors(prior.basis, strands, radius=radius)
    plot_reconstruction({"basis": rebuilt}, folder / "basis.png")
    progress("encoders")
    errors = {name: encoder_errors(prior, some, sorted(VIEWS)) for name, some in styles.items()}
    _plot_errors(errors, folder / "encoders.png")
    _plot_course(course, folder / "training.png")
    progress("pictures")
    shown = list({style.family: style for some in styles.values() for style in some}.values())
    with atomic_file(folder / "hairstyles.png") as temporary:
        Image.fromarray(hairstyle_sheet(prior, shown)).save(temporary)
    report = {
        "recipe": prior.recipe,
        "basis": [asdict(error) for error in rebuilt],
        "encoders": {name: [asdict(error) for error in some] for name, some in errors.items()},
        "course": [dict(entry) for entry in course],
    }
    write_json(folder / "report.json", report)
    return report


@torch.no_grad()
def hairstyle_sheet(prior: HairPrior, styles: Sequence[StyleViews]) -> Picture:
    """True hairstyles and what the prior makes of four and of all views, from the front, the side and behind."""
    rows = []
    for style in styles:
        vertices, faces, scalp = random_head(style.head)
        roots, _ = texture_roots(vertices, faces, scalp, style.frame, TEXTURE)
        positions, _ = smooth_surface(roots, vertices, faces)
        body = surface_gaussians(vertices, faces)
        hairs = [style.strands.float()]
        for count in (min(VIEWS), max(VIEWS)):
            coefficients = prior(Maps.of(style, VIEWS[count]).evidence())
            hairs.append(decoded(prior, coefficients, style.texels, style.strands.shape[1]))
        pictures = [_pictures(positions[:, None] + style.frame.radius * hair, body, style) for hair in hairs]
        rows.append([picture for each in pictures for picture in each])
    sides = ("front", "side", "back")
    labels = [f"{name}, {side}" for name in ("true", f"{min(VIEWS)} views", f"{max(VIEWS)} views") for side in sides]
    return grid(rows, [style.family for style in styles], labels)


def _pictures(strands: Float[Tensor, "n p 3"], body: Gaussians, style: StyleViews) -> list[Picture]:
    """Hair coloured by its direction in space, before a grey head."""
    hair = strand_gaussians(strands, _PICTURED_WIDTH)
    light = 0.35 + 0.65 * functional.normalize(body.means - style.frame.centre, dim=1)[:, 1:2].clamp_min(0)
    colours = torch.cat([0.15 + 0.85 * hair.directions.abs(), 0.5 * light.expand(-1, 3)])
    scene = strands_and_body(hair, body, colours)
    ring = range(FRONT_VIEWS, FRONT_VIEWS + RING_VIEWS)
    turns = [style.cameras[index].centre - style.frame.centre for index in ring]
    azimuths = torch.tensor([float(torch.atan2(turn[0], turn[2])) for turn in turns])
    chosen = []
    for wanted in (0.0, torch.pi / 2, torch.pi):
        apart = torch.remainder(azimuths - wanted + torch.pi, 2 * torch.pi) - torch.pi
        chosen.append(style.cameras[ring[int(apart.abs().argmin())]].resized(160, 160))
    images = rasterize(scene, chosen).features
    return [(255 * image.clamp(0, 1)).byte().numpy() for image in images]


def _distance(prior: HairPrior, coefficients: Tensor, style: StyleViews) -> float:
    target = Target.of(style, _POINTS)
    strands = decoded(prior, coefficients, target.texels, _POINTS)
    return 1e3 * style.frame.radius * float((strands - target.strands)[:, 1:].norm(dim=-1).mean())


def _normal_strands(styles: Sequence[StyleViews]) -> Float[Tensor, "n 200 3"]:
    strands = [style.frame.radius * style.strands[::8].float() for style in styles]
    return torch.cat([normal_form(some, style.frame) for some, style in zip(strands, styles, strict=True)])


def _plot_errors(errors: Mapping[str, Sequence[EncoderError]], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2 * len(errors), 3.2), layout="constrained")
    panels = figure.subplots(1, len(errors), sharey=True, squeeze=False)[0]
    for panel, (name, rows) in zip(panels, errors.items(), strict=True):
        counts = sorted({row.views for row in rows})
        for label, field in zip(_COLOURS, ("mean_hairstyle", "coarse", "fine"), strict=True):
            means = [np.mean([getattr(row, field) for row in rows if row.views == count]) for count in counts]
            panel.plot(counts, means, "o-", color=_COLOURS[label], label=label, markersize=3)
        panel.set_title(name, fontsize=9)
        panel.set_xlabel("views")
        panel.set_ylim(bottom=0)
        panel.grid(alpha=0.25)
    panels[0].set_ylabel("points, mean distance in mm")
    panels[0].legend(fontsize=8, frameon=False)
    with atomic_file(path) as temporary:
        figure.savefig(temporary, dpi=130)


def _plot_course(course: Sequence[Mapping[str, float | int]], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.2), layout="constrained")
    loss, distance = figure.subplots(1, 2)
    steps = [entry["step"] for entry in course]
    loss.plot(steps, [entry["loss"] for entry in course], color="#3b6fb6")
    loss.set_ylabel("loss, training")
    for name, colour in (("known", "#3b6fb6"), ("held_out", "#d1495b")):
        distance.plot(steps, [entry[name] for entry in course], color=colour, label=name.replace("_", " "))
    distance.set_ylabel("points, mean distance in mm")
    distance.set_ylim(bottom=0)
    distance.legend(fontsize=8, frameon=False)
    for panel in (loss, distance):
        panel.set_xlabel("steps")
        panel.grid(alpha=0.25)
    with atomic_file(path) as temporary:
        figure.savefig(temporary, dpi=130)
