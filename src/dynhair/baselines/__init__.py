"""Heads to compare the avatar with, each trained on the same capture: Gaussians without strands, and a simulator."""

from dynhair.baselines.loading import open_driven_head
from dynhair.baselines.training import BaselineName, train_baseline

__all__ = ["BaselineName", "open_driven_head", "train_baseline"]
