"""Surfaces out of signed distances, drawn and compared: what a mesh that is fitted to images needs."""

from dynhair.mesh.distances import chamfer, surface_samples
from dynhair.mesh.gaussians import triangle_gaussians
from dynhair.mesh.grid import TetrahedralGrid
from dynhair.mesh.losses import laplacian_loss, silhouette_iou_loss
from dynhair.mesh.marching import Surface, marching_tetrahedra

__all__ = [
    "Surface",
    "TetrahedralGrid",
    "chamfer",
    "laplacian_loss",
    "marching_tetrahedra",
    "silhouette_iou_loss",
    "surface_samples",
    "triangle_gaussians",
]
