"""Captures on disk: multi-view images of a head in motion with masks, cameras and tracking."""

from dynhair.capture.reader import Capture
from dynhair.capture.records import GroundTruth, HeadTrack, Segment, TrackedMesh, View

__all__ = ["Capture", "GroundTruth", "HeadTrack", "Segment", "TrackedMesh", "View"]
