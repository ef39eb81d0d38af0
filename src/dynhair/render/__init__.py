"""Gaussians to images: :func:`rasterize`, on the CPU, on CUDA and, as a reference, in plain PyTorch."""

from dynhair.render.gaussians import Gaussians, Rendering
from dynhair.render.rasterization import Backend, rasterize

__all__ = ["Backend", "Gaussians", "Rendering", "rasterize"]
