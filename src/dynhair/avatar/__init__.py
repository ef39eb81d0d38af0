"""The avatar: hair, head, and their union."""

from dynhair.avatar.avatar import Avatar
from dynhair.avatar.deformer import HairDeformer, PaperDeformer
from dynhair.avatar.drawing import AvatarImages, PosedAvatar
from dynhair.avatar.expression_modes import ExpressionModes
from dynhair.avatar.hair import Hair
from dynhair.avatar.head import Head, HeadGaussians, HeadStart
from dynhair.avatar.head_mesh import HeadMesh
from dynhair.avatar.head_pose import HeadPose, head_pose
from dynhair.avatar.live import LiveAvatar
from dynhair.avatar.modal import ModalDeformer
from dynhair.avatar.recording import Recording
from dynhair.avatar.scalp_layer import ScalpLayer
from dynhair.avatar.strand_deformer import StrandDeformer

__all__ = [
    "Avatar",
    "AvatarImages",
    "ExpressionModes",
    "Hair",
    "HairDeformer",
    "Head",
    "HeadGaussians",
    "HeadMesh",
    "HeadPose",
    "HeadStart",
    "LiveAvatar",
    "ModalDeformer",
    "PaperDeformer",
    "PosedAvatar",
    "Recording",
    "ScalpLayer",
    "StrandDeformer",
    "head_pose",
]
