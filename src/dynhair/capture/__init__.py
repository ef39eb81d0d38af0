"""Captures on disk: multi-view images of a head in motion with masks, cameras and tracking."""

from dynhair.capture.expression_basis import ExpressionBasis
from dynhair.capture.manifest import Manifest
from dynhair.capture.reader import DEFAULT_CACHE_BYTES, Capture
from dynhair.capture.records import GroundTruth, HeadTrack, Segment, TrackedMesh, View
from dynhair.capture.writer import CaptureWriter, ImageCoding

__all__ = [
    "DEFAULT_CACHE_BYTES",
    "Capture",
    "CaptureWriter",
    "ExpressionBasis",
    "GroundTruth",
    "HeadTrack",
    "ImageCoding",
    "Manifest",
    "Segment",
    "TrackedMesh",
    "View",
]
