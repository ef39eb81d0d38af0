"""The Gaussian head's start on the surface that the mesh stage found (paper, appendix A)."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dynhair.avatar import Head, HeadStart, head_pose
from dynhair.avatar.branches import expression_weight
from dynhair.avatar.mesh_head import MeshHead
from dynhair.capture import Capture
from dynhair.config import HeadConfig
from dynhair.strands import sample_roots
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.head_start import TRANSLUCENT, StartedHead, mean_spacing, mouth_points
from dynhair.training.mesh_start import start_of_mesh, take_over
from dynhair.training.surface import tracked_surface

SCALP_SAMPLES = 4000
SCALP_REACH = 0.012  # metres


def start_head_on_mesh(mesh_head: MeshHead, capture: Capture, config: HeadConfig, seed: int) -> StartedHead:
    """A head whose Gaussians lie on the mesh stage's surface and around the mouth, and that has its networks.

    Args:
        mesh_head: trained on the capture.
        capture: tells where the scalp is.
        config: sizes.
        seed: of the places drawn.
    """
    segment, index = rest_frame(capture)
    skin = start_of_mesh(mesh_head, config, seed)
    landmarks = mesh_head.landmarks.detach()
    order = expression_weight(skin.means, landmarks, config.near, config.far).argsort(descending=True, stable=True)
    mouth = mouth_points(landmarks, skin.means, config.mouth_gaussians, seed)
    means = torch.cat([mouth, skin.means[order]])
    ones = torch.ones(len(mouth))
    with torch.no_grad():
        colours = torch.cat([mesh_head.look(mouth)[0], skin.colours[order]])
    start = HeadStart(
        means=means,
        normals=torch.cat([mouth.new_tensor([0.0, 0.0, 1.0]).expand_as(mouth), skin.normals[order]]),
        spacing=mean_spacing(means),
        colours=colours,
        opacities=torch.cat([TRANSLUCENT * ones, skin.opacities[order]]),
        follow=torch.cat([ones, skin.follow[order]]),
    )
    torch.manual_seed(seed)
    head = Head(start, landmarks, head_pose(capture.track(segment), index), config)
    take_over(head, mesh_head)
    return StartedHead(head, None, near_scalp(capture, means))


def near_scalp(capture: Capture, means: Float[Tensor, "k 3"]) -> Int64[Tensor, " s"]:
    """Indices of the points on the scalp of the tracked surface, or nearly.

    Args:
        capture: with a tracked surface.
        means: in the rest frame, head frame, metres.
    """
    from pykdtree.kdtree import KDTree

    surface = tracked_surface(capture)
    segment, index = rest_frame(capture)
    vertices = head_frame(capture.track(segment), index)(surface.vertices(segment.start + index))
    scalp = sample_roots(vertices, surface.faces, surface.scalp, SCALP_SAMPLES, 0).positions(vertices)
    distances, _ = KDTree(np.ascontiguousarray(scalp.numpy())).query(np.ascontiguousarray(means.numpy()))
    return torch.nonzero(torch.from_numpy(distances) < SCALP_REACH).squeeze(1)
