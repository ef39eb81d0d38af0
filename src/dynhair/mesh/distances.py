"""How far two surfaces are apart."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from pykdtree.kdtree import KDTree
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.strands import sample_roots


def surface_samples(
    vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"], count: int, seed: int
) -> Float[Tensor, "n 3"]:
    """Points spread over a surface uniformly by area, in random order.

    Args:
        vertices: of the mesh.
        faces: its triangles.
        count: number of points.
        seed: of the random numbers.

    Raises:
        DynhairError: the surface has no faces or no area.
    """
    every_face = torch.arange(len(faces), device=faces.device)
    try:
        return sample_roots(vertices, faces, every_face, count, seed).positions(vertices)
    except DynhairError:
        raise DynhairError("the surface has no area to sample", expected="a mesh with triangles") from None


def chamfer(points_a: Float[Tensor, "a 3"], points_b: Float[Tensor, "b 3"]) -> float:
    """Mean distance of a point to the nearest one of the other set, averaged over both directions, metres.

    Two surfaces are compared by their :func:`surface_samples`; samples of one surface are apart by about half the
    spacing of the points.

    Raises:
        DynhairError: one set has no points.
    """
    a, b = (points.detach().cpu().double().numpy() for points in (points_a, points_b))
    if not (len(a) and len(b)):
        raise DynhairError(f"there is no distance between {len(a)} points and {len(b)}", expected="points in both sets")
    there, back = KDTree(b).query(a)[0], KDTree(a).query(b)[0]
    return float(np.mean(there) + np.mean(back)) / 2
