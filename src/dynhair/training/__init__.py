"""Training: from a capture to an avatar.

The trainer itself, :mod:`dynhair.training.trainer`, takes as long to load as all else, and is not loaded with this.
"""

from dynhair.training.recording import capture_recording, recording_of
from dynhair.training.run import avatar_folder, trained_capture

__all__ = ["avatar_folder", "capture_recording", "recording_of", "trained_capture"]
