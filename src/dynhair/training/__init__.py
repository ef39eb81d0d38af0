"""Training: from a capture to an avatar."""

from dynhair.training.run import avatar_folder, trained_capture
from dynhair.training.trainer import train

__all__ = ["avatar_folder", "train", "trained_capture"]
