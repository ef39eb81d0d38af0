"""Animation: what drives an avatar, what films it, and the frames that come of it."""

from dynhair.animation.motion_files import read_motion, write_motion
from dynhair.animation.procedural import MOTIONS, motion
from dynhair.animation.resampling import resampled
from dynhair.animation.smoothing import smoothed
from dynhair.animation.sources import driving_track, segment_motion
from dynhair.animation.timed_motion import RestPose, TimedMotion

__all__ = [
    "MOTIONS",
    "RestPose",
    "TimedMotion",
    "driving_track",
    "motion",
    "read_motion",
    "resampled",
    "segment_motion",
    "smoothed",
    "write_motion",
]
