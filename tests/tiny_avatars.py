"""A tiny avatar with random motion, a track that turns its head, and a camera before it."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar, Hair, Head, HeadStart, Recording, ScalpLayer, head_pose
from dynhair.camera import Camera
from dynhair.capture import ExpressionBasis, HeadTrack
from dynhair.config import DeformerConfig, HeadConfig
from dynhair.motion import SignalNormalizer

FRAMES = 5


TURNING = Rotation.from_euler("y", np.linspace(0, 1, FRAMES)[:, None]).as_matrix()


def head_track(rotations: np.ndarray = TURNING, translation: tuple[float, float, float] = (0, 0.7, 0)) -> HeadTrack:
    return HeadTrack(
        rotations=rotations,
        translations=np.tile(np.array(translation, np.float64), (FRAMES, 1)),
        expressions=np.random.default_rng(0).random((FRAMES, 4), np.float32),
        fps=10.0,
        gravity=np.array([0, -9.81, 0.0]),
    )


SMALL = DeformerConfig(hidden=8, width=16, history=2, knots=0)

MOTION_KINDS: tuple[dict[str, Any], ...] = (
    {},
    {"signals": "pose"},
    {"encoder": "mlp"},
    {"film": False},
    {"knots": 3},
    {"layers": 3},
    {"kind": "modal"},
    {"kind": "modal", "turn": True},
    {"kind": "strands", "history": 12, "guides": 5, "turn": True, "inextensible": True},
    {"inextensible": True},
)
"""Changes of :data:`SMALL` that give hair each way to move."""


def make_avatar(
    super_resolution: int = 1,
    basis: ExpressionBasis | None = None,
    deformer: DeformerConfig = SMALL,
    dynamic: bool = True,
) -> Avatar:
    torch.manual_seed(0)
    roots = torch.nn.functional.normalize(torch.randn(20, 3), dim=1) * 0.1
    strands = roots[:, None] + torch.linspace(0, 0.1, 8)[None, :, None] * torch.tensor([0.0, -1.0, 0.3])
    track = head_track()
    hair = Hair(strands, 0.008, torch.tensor([0.4, 0.2, 0.1]), deformer, dynamic, track.fps)
    means = torch.nn.functional.normalize(torch.randn(100, 3), dim=1) * 0.09
    config = HeadConfig(
        features=4,
        deformation_width=8,
        appearance_width=8,
        super_resolution=super_resolution,
        super_resolution_channels=5,
    )
    start = HeadStart(
        means=means,
        normals=means / 0.09,
        spacing=torch.full((100,), 0.01),
        colours=torch.rand(100, 3),
        opacities=torch.full((100,), 0.95),
        follow=torch.rand(100),
    )
    head = Head(start, means[:5], head_pose(head_track(), 0), config)
    scalp = ScalpLayer.under(strands[:, 0], means, torch.arange(0, 100, 5))
    recording = Recording(track.fps, track.gravity, head_pose(track, 0), front_camera())
    avatar = Avatar(hair, head, SignalNormalizer(deformer), torch.tensor([0.1, 0.2, 0.3]), scalp, basis, recording)
    with torch.no_grad():
        for parameter in avatar.hair.deformer.parameters():
            parameter.copy_(torch.randn_like(parameter) * 0.2)
    return avatar


def front_camera(size: int = 40) -> Camera:
    w2c = torch.tensor([[1.0, 0, 0, 0], [0, -1, 0, 0.7], [0, 0, -1, 0.8]])
    return Camera(w2c, torch.tensor([[80.0, 0, size / 2], [0, 80, size / 2], [0, 0, 1]]), size, size)
