"""Where strands grow: roots on the scalp of a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from pykdtree.kdtree import KDTree
from torch import Tensor

from dynhair.errors import DynhairError


@dataclass(frozen=True)
class Roots:
    """Points that are fixed on the triangles of a mesh, whatever its shape.

    Attributes:
        face: index of the mesh's face that each root lies on.
        triangle: vertex indices of that face.
        barycentric: weights of those vertices; they sum to 1.
    """

    face: Int[Tensor, " n"]
    triangle: Int[Tensor, "n 3"]
    barycentric: Float[Tensor, "n 3"]

    def __getitem__(self, rows: Int[Tensor, " m"]) -> Roots:
        """Some of the roots, in the order of their indices."""
        return Roots(self.face[rows], self.triangle[rows], self.barycentric[rows])

    def positions(self, vertices: Float[Tensor, "v 3"]) -> Float[Tensor, "n 3"]:
        """Place the roots on a mesh of the same topology; differentiable in its vertices."""
        return (vertices[self.triangle] * self.barycentric.to(vertices)[..., None]).sum(dim=1)

    def interpolate(self, values: Float[Tensor, " v"]) -> Float[Tensor, " n"]:
        """What the mesh's vertices hold, where the roots lie."""
        return (values[self.triangle] * self.barycentric.to(values)).sum(dim=1)

    def normals(self, vertices: Float[Tensor, "v 3"]) -> Float[Tensor, "n 3"]:
        """Take the unit normals of the roots' faces, outwards for counter-clockwise faces."""
        a, b, c = vertices[self.triangle].unbind(dim=1)
        return torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a, dim=-1), dim=-1)


def sample_roots(
    vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"], scalp: Int[Tensor, " s"], count: int, seed: int
) -> Roots:
    """Spread roots over the scalp, uniformly by area.

    The faces are laid end to end by their areas and one root is drawn from each of ``count`` equal stretches, so that
    a face's number of roots differs from its share by less than two. Computed in float64 from plain uniform draws of
    NumPy's PCG64: a seed gives the same roots on every platform.

    Args:
        vertices: the mesh that areas are measured on.
        faces: its triangles.
        scalp: indices of the faces that grow hair.
        count: number of roots.
        seed: of the random numbers.

    Returns:
        Roots in random order, so that any leading part of them covers the scalp.

    Raises:
        DynhairError: the scalp has no faces or no area.
    """
    triangles = faces[scalp].cpu()
    a, b, c = vertices.detach().cpu().double()[triangles].numpy().swapaxes(0, 1)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    if not areas.sum() > 0:
        raise DynhairError("the scalp has no area to grow hair on", expected="scalp faces of a mesh")
    random = np.random.Generator(np.random.PCG64(seed))
    places = (np.arange(count) + random.random(count)) / count
    places = places[np.argsort(random.random(count), kind="stable")]
    drawn = np.searchsorted(np.cumsum(areas) / areas.sum(), places, side="right").clip(max=len(areas) - 1)

    radial, angular = np.sqrt(random.random(count)), random.random(count)
    barycentric = np.stack([1 - radial, radial * (1 - angular), radial * angular], axis=1)
    chosen = torch.from_numpy(drawn)
    return Roots(
        face=scalp.cpu()[chosen].to(faces.device),
        triangle=triangles[chosen].to(faces.device),
        barycentric=torch.from_numpy(barycentric).to(vertices),
    )


def smooth_surface(
    roots: Roots, vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"]
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
    """Place roots on the curved surface that a coarse mesh stands for (Phong tessellation, Boubekeur and Alexa 2008).

    A root's position on its flat triangle is drawn halfway to its projections on the tangent planes of the corners.
    Halfway is what reproduces a sphere to second order in the edges' length; the three quarters of the literature,
    chosen for the look of outlines, would bulge a head's triangles by half as much as they are flat.

    Args:
        roots: on the mesh.
        vertices: the mesh.
        faces: its triangles, counter-clockwise from outside; also those beside the scalp, for the normals at its hem.

    Returns:
        Positions, and unit normals blended from the corners' (the normals of a vertex's faces weighted by area).
    """
    a, b, c = vertices[faces].unbind(dim=1)
    weighted = torch.linalg.cross(b - a, c - a, dim=-1)
    summed = torch.zeros_like(vertices).index_add(0, faces.flatten(), weighted.repeat_interleave(3, dim=0))
    normals = torch.nn.functional.normalize(summed, dim=-1)[roots.triangle]
    weights = roots.barycentric.to(vertices)[..., None]
    flat = roots.positions(vertices)
    heights = ((vertices[roots.triangle] - flat[:, None]) * normals).sum(dim=-1, keepdim=True)
    positions = flat + (weights * heights * normals).sum(dim=1) / 2
    return positions, torch.nn.functional.normalize((weights * normals).sum(dim=1), dim=-1)


def root_neighbours(roots: Float[Tensor, "n 3"], k: int) -> Int[Tensor, "n k"]:
    """Find the ``k`` nearest other roots of each root, nearest first.

    Args:
        roots: root positions.
        k: neighbours for each.

    Raises:
        DynhairError: there are not that many other roots.
    """
    count = len(roots)
    if not 0 < k < count:
        raise DynhairError(f"cannot find {k} neighbours among {count} roots", expected=f"1 to {count - 1} neighbours")
    points = np.ascontiguousarray(roots.detach().cpu().numpy())
    _, found = KDTree(points).query(points, k=k + 1)
    found = torch.from_numpy(found.astype(np.int64))
    # A root is its own nearest one, unless others lie on the very same spot and push it back or out.
    own = found == torch.arange(count)[:, None]
    own[:, -1] |= ~own.any(dim=1)
    return found[~own].view(count, k).to(roots.device)
