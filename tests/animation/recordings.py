"""A recording whose head rests turned, and a smooth motion that is known at any instant."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from dynhair.animation import RestPose, TimedMotion
from dynhair.avatar import HeadPose, Recording
from dynhair.camera import Camera

FPS = 30.0
REST = Rotation.from_rotvec([0.1, -0.7, 0.2]).as_matrix()
ORIGIN = np.array([0.2, 1.5, -0.4])
NEUTRAL = np.array([0.5, 0.0, -0.25], np.float32)


def make_recording(expressions: int = 3, size: tuple[int, int] = (40, 30)) -> Recording:
    w2c = torch.tensor([[1.0, 0, 0, -0.2], [0, -1, 0, 1.6], [0, 0, -1, 0.8]])
    K = torch.tensor([[80.0, 0, 20], [0, 80, 15], [0, 0, 1]])
    rest = HeadPose(
        rotation=torch.from_numpy(REST).float(),
        translation=torch.from_numpy(ORIGIN).float(),
        rotation_vector=torch.tensor([0.1, -0.7, 0.2]),
        expression=torch.from_numpy(NEUTRAL[:expressions]),
    )
    return Recording(FPS, np.array([0.0, -9.81, 0.0]), rest, Camera(w2c, K, *size))


def smooth_motion(times: np.ndarray, phase: float = 0.0) -> TimedMotion:
    """Sums of sines up to 2 Hz about all axes at once."""
    angles = 2 * np.pi * times[:, None] * [0.7, 2.0, 1.3] + [phase, 1.0, 2.0]
    rotations = Rotation.from_rotvec(np.sin(angles) * [0.3, 0.4, 0.2]).as_matrix()
    return TimedMotion(
        times=times,
        rotations=rotations,
        translations=0.05 * np.cos(angles),
        expressions=(0.5 + 0.5 * np.sin(angles)).astype(np.float32),
        rest=RestPose(np.eye(3), np.zeros(3), np.zeros(3, np.float32)),
        gravity=np.array([0.0, -9.81, 0.0]),
    )
