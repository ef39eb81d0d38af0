"""The study's hairstyles: guide strands on the open head, and what Blender's hair is made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from jaxtyping import Float, Int

from dynhair.face.open_head import open_head
from dynhair.hairstyles import HeadField, Style, grow_hairstyle
from dynhair.strands.scalp import sample_roots
from dynhair.strands.scalp_map import ScalpFrame

GUIDES, POINTS = 96, 16
CANDIDATES = 12
"""Roots that are drawn for each that is kept, so that these lie evenly."""


@dataclass(frozen=True)
class Material:
    """Blender's settings of hair dynamics; what is not here keeps Blender's defaults.

    Attributes:
        mass: of a point.
        bending: stiffness.
        bending_damping: of bending.
        tension: stiffness against stretching.
        air: drag.
    """

    mass: float
    bending: float
    bending_damping: float = 0.2
    tension: float = 80.0
    air: float = 2.0


@dataclass(frozen=True)
class Groom:
    """A hairstyle and its material."""

    style: Style
    material: Material


GROOMS = {
    "long": Groom(
        Style(seed=1, length=0.6, hem=0.24, parting=0.1, sweep=0.9, fall=0.12, thickness=0.014, front=0.25),
        Material(mass=0.3, bending=1.0),
    ),
    "wavy": Groom(
        Style(
            seed=2,
            length=0.36,
            hem=0.15,
            parting=-0.35,
            sweep=0.7,
            thickness=0.018,
            front=0.2,
            wave_amplitude=0.007,
            wave_length=0.08,
            wave_disorder=0.4,
            curl=0.3,
        ),
        Material(mass=0.25, bending=4.0),
    ),
    "shoulders": Groom(
        Style(seed=3, length=0.46, hem=0.19, parting=0.0, sweep=0.8, fall=0.1, thickness=0.016, front=0.2),
        Material(mass=0.3, bending=2.0),
    ),
    "bob": Groom(
        Style(seed=4, length=0.3, hem=0.09, parting=0.25, sweep=0.6, thickness=0.02, front=0.15),
        Material(mass=0.3, bending=5.0),
    ),
    "loose": Groom(
        Style(
            seed=5,
            length=0.55,
            hem=0.28,
            parting=-0.15,
            sweep=1.2,
            thickness=0.016,
            front=0.3,
            wave_amplitude=0.004,
            wave_length=0.12,
        ),
        Material(mass=0.25, bending=1.0, air=1.0),
    ),
}
"""What hair is taught by: from a stiff bob to loose hair that hardly feels the air."""

STUDIED = ("long", "wavy")
"""Rows are compared on straight hair to below the shoulders, and shorter wavy hair that is four times as stiff."""


@dataclass(frozen=True)
class HeadMesh:
    """Head and shoulders in the head frame at rest, metres, y up.

    Attributes:
        vertices: at rest.
        faces: triangles.
        scalp: indices of the faces that grow hair.
        weight: 1 moves with the head, 0 stays with the shoulders.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    scalp: Int[np.ndarray, " s"]
    weight: Float[np.ndarray, " v"]


@cache
def head_mesh() -> HeadMesh:
    """The open head's average person."""
    model = open_head()
    return HeadMesh(*(part.numpy() for part in (model.mean, model.faces, model.scalp, model.head_weight)))


@cache
def guides(groom: str) -> Float[np.ndarray, "n k 3"]:
    """A hairstyle's guide strands as they are combed, before physics; root first, head frame, metres."""
    model = open_head()
    frame = ScalpFrame.of(model.mean, model.faces, model.scalp)
    roots = sample_roots(model.mean, model.faces, model.scalp, CANDIDATES * GUIDES, seed=0)
    roots = roots[_spread(roots.positions(model.mean), GUIDES)]
    strands = grow_hairstyle(
        GROOMS[groom].style,
        roots.positions(model.mean),
        roots.normals(model.mean),
        frame,
        HeadField.of(model.mean, model.faces),
        POINTS,
    )
    return strands.numpy()


def _spread(positions: torch.Tensor, count: int) -> torch.Tensor:
    """Each the farthest from those before it, the highest first."""
    chosen = [int(positions[:, 1].argmax())]
    distance = torch.full((len(positions),), torch.inf)
    while len(chosen) < count:
        distance = torch.minimum(distance, (positions - positions[chosen[-1]]).norm(dim=1))
        chosen.append(int(distance.argmax()))
    return torch.tensor(chosen)
