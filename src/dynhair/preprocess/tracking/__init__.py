"""Head tracking: pose, expression and mesh of the head in every frame, from landmarks in all views."""

from dynhair.preprocess.tracking.diagnostics import CameraDiagnostics, TrackingDiagnostics
from dynhair.preprocess.tracking.observations import Observations
from dynhair.preprocess.tracking.result import TrackingResult
from dynhair.preprocess.tracking.take_track import TakeTrack
from dynhair.preprocess.tracking.track import TrackingOptions, track_head
from dynhair.preprocess.tracking.warning import TrackingWarning, tracking_warnings

__all__ = [
    "CameraDiagnostics",
    "Observations",
    "TakeTrack",
    "TrackingDiagnostics",
    "TrackingOptions",
    "TrackingResult",
    "TrackingWarning",
    "track_head",
    "tracking_warnings",
]
