"""Cameras around a head, and what they see of simple hair."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from dynhair.camera import Camera
from dynhair.strands.scalp_map import ScalpFrame

FRAME = ScalpFrame(torch.tensor([0.01, 0.06, -0.02]), 0.1)


def camera_at(azimuth: float, elevation: float = 0.0, distance: float = 1.0, size: int = 64) -> Camera:
    """A square view of the frame's surroundings; azimuth 0 is in front of the face. Angles in degrees."""
    a, e = math.radians(azimuth), math.radians(elevation)
    away = torch.tensor([math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)])
    target = FRAME.centre - torch.tensor([0.0, 0.1, 0.0])
    across = functional.normalize(torch.linalg.cross(-away, torch.tensor([0.0, 1.0, 0.0]), dim=0), dim=0)
    rotation = torch.stack([across, torch.linalg.cross(-away, across, dim=0), -away])
    focal = 1.5 * size
    K = torch.tensor([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])
    eye = target + distance * away
    return Camera(torch.cat([rotation, -(rotation @ eye)[:, None]], 1), K, size, size)


def seen_line(start: Tensor, end: Tensor, camera: Camera, width: float) -> tuple[Tensor, Tensor]:
    """Mask and doubled angles of a straight line, ``width`` pixels wide."""
    (a, b), _ = camera.project(torch.stack([start, end]))
    along = functional.normalize(b - a, dim=0)
    axis = torch.arange(camera.width) + 0.5
    rows, columns = torch.meshgrid(axis, axis, indexing="ij")
    offset = torch.stack([columns, rows], -1) - a
    t = (offset @ along).clamp(0, float((b - a).norm()))
    mask = ((offset - t[..., None] * along).norm(dim=-1) < width / 2).float()
    doubled = torch.stack([along[0] ** 2 - along[1] ** 2, 2 * along[0] * along[1]])
    return mask, mask[..., None] * doubled


def noise_views(count: int, size: int, seed: int) -> tuple[list[Camera], Tensor, Tensor, Tensor]:
    """Cameras, random blobs of hair with random directions, and a body that fills a part of each image."""
    random = torch.Generator().manual_seed(seed)
    azimuths = (torch.rand(count, generator=random) * 360).tolist()
    cameras = [camera_at(azimuth, 20 * (i % 3 - 1), 0.8 + 0.1 * i, size) for i, azimuth in enumerate(azimuths)]
    coarse = torch.rand(count, 4, 5, 5, generator=random)
    maps = functional.interpolate(coarse, (size, size), mode="bilinear")
    hair = (1.6 * maps[:, 0]).clamp(0, 1)
    angle = 3 * torch.pi * maps[:, 1]
    direction = torch.stack([angle.cos(), angle.sin()], -1) * (maps[:, 2] * hair)[..., None]
    body = torch.where(maps[:, 3] > 0.5, 0.9 + 0.4 * maps[:, 3], torch.inf)
    return cameras, hair, direction, body
