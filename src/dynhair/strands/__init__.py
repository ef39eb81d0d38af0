"""Hair strands: polylines ``(N, L, 3)`` in metres, root first, and the scalp they grow on."""

from dynhair.strands.collision import MeshDistance, Obstacle, push_out
from dynhair.strands.gaussians import StrandGaussians, root_taper, strand_gaussians, strands_and_body
from dynhair.strands.geometry import (
    bending_angles,
    cut_strands,
    resample_strands,
    segment_lengths,
    smooth_strands,
    strand_lengths,
    with_lengths,
)
from dynhair.strands.orientation import decode_orientation, encode_orientation, projected_orientation
from dynhair.strands.scalp import Roots, root_neighbours, sample_roots, smooth_surface
from dynhair.strands.scalp_map import ScalpFrame, directions, texel_uv, texture_roots
from dynhair.strands.upsampling import upsample

__all__ = [
    "MeshDistance",
    "Obstacle",
    "Roots",
    "ScalpFrame",
    "StrandGaussians",
    "bending_angles",
    "cut_strands",
    "decode_orientation",
    "directions",
    "encode_orientation",
    "projected_orientation",
    "push_out",
    "resample_strands",
    "root_neighbours",
    "root_taper",
    "sample_roots",
    "segment_lengths",
    "smooth_strands",
    "smooth_surface",
    "strand_gaussians",
    "strand_lengths",
    "strands_and_body",
    "texel_uv",
    "texture_roots",
    "upsample",
    "with_lengths",
]
