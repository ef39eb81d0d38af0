"""Morphable face models: the open head that comes with the package, others from the user's files, and registration."""

from dynhair.face.anchor_transfer import face_anchors
from dynhair.face.choice import face_model
from dynhair.face.model import FaceModel
from dynhair.face.open_head import open_head
from dynhair.face.registration import Registration, register

__all__ = ["FaceModel", "Registration", "face_anchors", "face_model", "open_head", "register"]
