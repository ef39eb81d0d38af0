"""Head motion: the signals that drive the hair."""

from dynhair.motion.normalization import GRAVITY, HeadAtRest, SignalNormalizer, signal_names
from dynhair.motion.rest_alignment import RestAlignment
from dynhair.motion.rotations import cross_matrix, so3_exp, so3_log
from dynhair.motion.signals import MotionSignals, motion_signals
from dynhair.motion.windows import motion_window

__all__ = [
    "GRAVITY",
    "HeadAtRest",
    "MotionSignals",
    "RestAlignment",
    "SignalNormalizer",
    "cross_matrix",
    "motion_signals",
    "motion_window",
    "signal_names",
    "so3_exp",
    "so3_log",
]
