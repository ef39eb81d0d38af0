"""Losses: pure functions of tensors, each a mean or a sum as the paper has it, without its weight."""

from dynhair.losses.colour import (
    colour_consistency_loss,
    colour_gradient_loss,
    colour_neighbours,
    colour_spatial_loss,
)
from dynhair.losses.crops import Crop, perceptual_crop_loss, random_crops
from dynhair.losses.orientation import direction_loss, orientation_loss, orientation_weight
from dynhair.losses.perceptual import PerceptualDistance, lpips_loss
from dynhair.losses.photometric import l1_loss, ssim, ssim_loss, ssim_map
from dynhair.losses.physics import depth_loss, elastic_loss, penetration_loss, sample_strand_points
from dynhair.losses.reach import reach_loss
from dynhair.losses.regularizers import (
    grows_in_front,
    length_loss,
    pca_consistency_loss,
    shape_loss,
    smoothness_loss,
)
from dynhair.losses.silhouette import segmentation_loss, segmentation_weight

__all__ = [
    "Crop",
    "PerceptualDistance",
    "colour_consistency_loss",
    "colour_gradient_loss",
    "colour_neighbours",
    "colour_spatial_loss",
    "depth_loss",
    "direction_loss",
    "elastic_loss",
    "grows_in_front",
    "l1_loss",
    "length_loss",
    "lpips_loss",
    "orientation_loss",
    "orientation_weight",
    "pca_consistency_loss",
    "penetration_loss",
    "perceptual_crop_loss",
    "random_crops",
    "reach_loss",
    "sample_strand_points",
    "segmentation_loss",
    "segmentation_weight",
    "shape_loss",
    "smoothness_loss",
    "ssim",
    "ssim_loss",
    "ssim_map",
]
