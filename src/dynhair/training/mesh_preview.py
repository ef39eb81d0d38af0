"""The mesh head beside the truth."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from dynhair.avatar.head_pose import HeadPose
from dynhair.avatar.mesh_head import MeshHead, PosedMesh
from dynhair.camera import Camera
from dynhair.mesh import triangle_gaussians
from dynhair.pictures import grid
from dynhair.render import rasterize
from dynhair.training.batches import Batch
from dynhair.training.mesh_objective import mesh_images


@torch.no_grad()
def mesh_picture(
    head: MeshHead, pose: HeadPose, batch: Batch, background: Float[Tensor, "3"]
) -> UInt8[np.ndarray, "h w 3"]:
    """One frame in every view of a batch: the image, the mesh, and the mesh's normals as colours."""
    mesh = head(pose)
    rows = [batch.rgb, mesh_images(mesh, batch.cameras, background).rgb, normal_images(mesh, batch.cameras)]
    pictures = [[(view.clamp(0, 1) * 255 + 0.5).byte().cpu().numpy() for view in views] for views in rows]
    return grid(pictures, ["image", "mesh", "normals"], [str(place) for place in range(len(batch.rgb))])


def normal_images(mesh: PosedMesh, cameras: list[Camera]) -> Float[Tensor, "v h w 3"]:
    """The normals in the world, each component from -1 to 1 as one colour's from 0 to 1, on black."""
    a, b, c = mesh.vertices[mesh.faces].unbind(1)
    normals = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1)
    return rasterize(triangle_gaussians(mesh.vertices, mesh.faces, (normals + 1) / 2), cameras).features
