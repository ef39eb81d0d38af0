"""The avatar: hair, head, and their union."""

from dynhair.avatar.avatar import Avatar, AvatarImages, PosedAvatar, head_pose
from dynhair.avatar.deformer import HairDeformer
from dynhair.avatar.hair import Hair
from dynhair.avatar.head import Head, HeadGaussians, HeadPose

__all__ = [
    "Avatar",
    "AvatarImages",
    "Hair",
    "HairDeformer",
    "Head",
    "HeadGaussians",
    "HeadPose",
    "PosedAvatar",
    "head_pose",
]
