"""Face landmarks: 478 points of MediaPipe's Face Landmarker in every view, checked between views."""

from dynhair.preprocess.landmarks.blendshapes import BLENDSHAPE_NAMES
from dynhair.preprocess.landmarks.ibug68 import to_ibug68
from dynhair.preprocess.landmarks.landmarker import FaceLandmarker, FaceLandmarks, square_from_points
from dynhair.preprocess.landmarks.multiview import FaceInSpace, consistent_views, triangulate
from dynhair.preprocess.landmarks.networks import FaceNetworks
from dynhair.preprocess.landmarks.square import FaceSquare
from dynhair.preprocess.landmarks.store import load_landmarks, save_landmarks
from dynhair.preprocess.landmarks.track import FaceTrack, track_landmarks

__all__ = [
    "BLENDSHAPE_NAMES",
    "FaceInSpace",
    "FaceLandmarker",
    "FaceLandmarks",
    "FaceNetworks",
    "FaceSquare",
    "FaceTrack",
    "consistent_views",
    "load_landmarks",
    "save_landmarks",
    "square_from_points",
    "to_ibug68",
    "track_landmarks",
    "triangulate",
]
