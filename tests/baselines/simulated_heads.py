"""Small heads with hair to simulate."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar, Hair, Head, HeadStart, head_pose
from dynhair.baselines.cables import Part
from dynhair.baselines.simulator import HeadSurface
from dynhair.baselines.simulator_motion import RigidMotion
from dynhair.capture import HeadTrack
from dynhair.config import DeformerConfig, HeadConfig
from dynhair.motion import SignalNormalizer

GRAVITY = np.array([0.0, -9.81, 0.0])
HEAD_RADIUS = 0.1
POINTS = 16


def standing(frames: int = 1, fps: float = 30.0) -> RigidMotion:
    return RigidMotion(np.tile(np.eye(3), (frames, 1, 1)), np.zeros((frames, 3)), fps)


def straight(direction: tuple[float, float, float], length: float = 0.3, points: int = POINTS) -> np.ndarray:
    """One strand from the origin, (1, points, 3)."""
    along = np.array(direction, float) / np.linalg.norm(direction)
    return (np.linspace(0.0, length, points)[:, None] * along)[None]


def sphere(radius: float = HEAD_RADIUS, rings: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """A closed sphere about the origin: vertices and faces, counter-clockwise seen from outside."""
    polar = np.linspace(0.0, np.pi, rings + 1)[1:-1]
    around = np.linspace(0.0, 2 * np.pi, 2 * rings, endpoint=False)
    p, a = np.meshgrid(polar, around, indexing="ij")
    body = np.stack([np.sin(p) * np.sin(a), np.cos(p), np.sin(p) * np.cos(a)], -1).reshape(-1, 3)
    vertices = np.vstack([body, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]]) * radius
    wide, faces = 2 * rings, []
    for column in range(wide):
        following = (column + 1) % wide
        for ring in range(rings - 2):
            upper, lower = ring * wide, (ring + 1) * wide
            faces.append([upper + column, lower + column, lower + following])
            faces.append([upper + column, lower + following, upper + following])
        last = (rings - 2) * wide
        faces.append([len(body), column, following])
        faces.append([len(body) + 1, last + following, last + column])
    return vertices, np.array(faces)


def ball() -> Part:
    return Part(*sphere())


def head_surface() -> HeadSurface:
    vertices, faces = sphere()
    return HeadSurface(torch.from_numpy(vertices).float(), torch.from_numpy(faces), torch.ones(len(vertices)))


def nodding(frames: int = 4) -> HeadTrack:
    return HeadTrack(
        rotations=Rotation.from_euler("x", np.linspace(0.0, 0.5, frames)[:, None]).as_matrix(),
        translations=np.tile([0.0, 0.7, 0.0], (frames, 1)),
        expressions=np.zeros((frames, 4), np.float32),
        fps=10.0,
        gravity=GRAVITY,
    )


def haired_avatar(strands: int = 20) -> Avatar:
    """Strands that stand away from a ball, downwards on its sides."""
    generator = torch.Generator().manual_seed(0)
    roots = torch.randn(strands, 3, generator=generator)
    roots[:, 1].abs_()
    roots = torch.nn.functional.normalize(roots, dim=1) * HEAD_RADIUS
    along = torch.linspace(0.0, 0.1, 8)[None, :, None]
    canonical = roots[:, None] + along * (10 * roots[:, None] + torch.tensor([0.0, -0.5, 0.0]))
    deformer = DeformerConfig(hidden=4, width=4, history=2, knots=0)
    hair = Hair(canonical, 0.002, torch.tensor([0.4, 0.2, 0.1]), deformer)
    means = torch.nn.functional.normalize(torch.randn(50, 3, generator=generator), dim=1) * 0.09
    start = HeadStart(
        means=means,
        normals=means / 0.09,
        spacing=torch.full((50,), 0.01),
        colours=torch.rand(50, 3, generator=generator),
        opacities=torch.full((50,), 0.95),
        follow=torch.ones(50),
    )
    config = HeadConfig(features=4, deformation_width=4, appearance_width=4)
    head = Head(start, means[:5], head_pose(nodding(), 0), config)
    return Avatar(hair, head, SignalNormalizer(deformer), torch.zeros(3)).eval()
