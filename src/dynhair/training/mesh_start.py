"""From the mesh head to the Gaussian head: what its Gaussians begin as, and the networks that it takes over."""

from __future__ import annotations

import torch

from dynhair.avatar.head import Head, HeadStart
from dynhair.avatar.mesh_head import CanonicalMesh, MeshHead
from dynhair.config import HeadConfig
from dynhair.strands import sample_roots
from dynhair.training.head_start import OPAQUE, mean_spacing


@torch.no_grad()
def start_of_mesh(mesh_head: MeshHead, config: HeadConfig, seed: int) -> HeadStart:
    """Gaussians on the neutral mesh (paper, appendix A, "Canonical representation of the head").

    Gaussian Head Avatar puts one on every vertex that the mesh has after its grid is subdivided. Here there are as many
    as that, but no more than asked for, and they are spread over the mesh evenly by area: marching tetrahedra sets
    vertices now close together, now far apart.

    Args:
        mesh_head: trained.
        config: says how many Gaussians there may be.
        seed: of the places drawn.
    """
    mesh = mesh_head.canonical()
    count = min(vertices_when_subdivided(mesh), config.gaussians)
    places = sample_roots(mesh.vertices, mesh.faces, torch.arange(len(mesh.faces)), count, seed)
    means = places.positions(mesh.vertices)
    return HeadStart(
        means=means,
        normals=places.normals(mesh.vertices),
        spacing=mean_spacing(means),
        colours=mesh_head.look(means)[0],
        opacities=torch.full((count,), OPAQUE),
        follow=places.interpolate(mesh.follow),
    )


@torch.no_grad()
def take_over(head: Head, mesh_head: MeshHead) -> None:
    """Give a Gaussian head the mesh head's deformation, colour and skinning networks, and the features they know.

    The colours of its Gaussians are then the mesh's under every pose and expression.

    Args:
        head: begun as :func:`start_of_mesh` says, perhaps with Gaussians more; changed in place.
        mesh_head: trained, with networks of the same sizes.
    """
    head.deformation.load_state_dict(mesh_head.deformation.state_dict())
    head.colour.load_state_dict(mesh_head.colour.state_dict())
    head.skinning.load_state_dict(mesh_head.skinning.state_dict())
    head.features.copy_(mesh_head.look(head.means)[1])
    head.expression_weight.copy_(mesh_head.expression_weight(head.means))


def vertices_when_subdivided(mesh: CanonicalMesh) -> int:
    """Vertices of the mesh and of its edges' middles together."""
    edges = torch.cat([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]).sort(1).values
    return len(mesh.vertices) + len(torch.unique(edges, dim=0))
