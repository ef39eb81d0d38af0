"""Training: from a capture to an avatar."""

from dynhair.training.recording import capture_recording, recording_of
from dynhair.training.run import avatar_folder, trained_capture
from dynhair.training.trainer import train

__all__ = ["avatar_folder", "capture_recording", "recording_of", "train", "trained_capture"]
