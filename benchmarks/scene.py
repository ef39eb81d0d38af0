"""A made-up head of hair: strands over a ball of flat Gaussians, as large as life, seen from a metre away."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import normalize

from dynhair.camera import Camera
from dynhair.render import Gaussians

HEAD_RADIUS = 0.10  # metres
SEGMENTS = 39  # of a strand
SEGMENT_LENGTH = 0.005  # metres
DOWN = torch.tensor([0.0, 1.0, 0.0])  # the world is the camera's: y down


def hair_scene(strands: int, head: int, channels: int = 8, seed: int = 0) -> Gaussians:
    """``strands * 39`` thin hair Gaussians and ``head`` round ones below them."""
    generator = torch.Generator().manual_seed(seed)
    points = _grow(strands, generator)
    starts, ends = points[:, :-1].reshape(-1, 3), points[:, 1:].reshape(-1, 3)
    lengths = (ends - starts).norm(dim=1)
    directions = (ends - starts) / lengths[:, None]
    widths = torch.empty(strands).uniform_(0.15e-3, 0.5e-3, generator=generator).repeat_interleave(SEGMENTS)
    skin = normalize(torch.randn(head, 3, generator=generator), dim=1)
    spacing = (4 * torch.pi * HEAD_RADIUS**2 / head) ** 0.5
    colours = torch.rand(strands, channels, generator=generator).repeat_interleave(SEGMENTS, dim=0)
    return Gaussians(
        means=torch.cat([(starts + ends) / 2, HEAD_RADIUS * skin]),
        quats=torch.cat([_turn_x_to(directions), torch.tensor([[1.0, 0.0, 0.0, 0.0]]).expand(head, 4)]),
        scales=torch.cat([torch.stack([lengths / 2, widths, widths], dim=1), torch.full((head, 3), 0.6 * spacing)]),
        opacities=torch.cat([torch.ones(len(starts)), torch.full((head,), 0.9)]),
        features=torch.cat(
            [
                0.8 * colours + 0.2 * torch.rand(len(starts), channels, generator=generator),
                torch.rand(head, channels, generator=generator),
            ]
        ),
    )


def hair_camera(size: int) -> Camera:
    """A square view that the hair fills."""
    focal = 3.57 * size
    w2c = torch.tensor([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, -0.03], [0.0, 0.0, 1.0, 1.0]])
    return Camera(
        w2c, torch.tensor([[focal, 0.0, size / 2], [0.0, focal, size / 2], [0.0, 0.0, 1.0]]), width=size, height=size
    )


def _grow(strands: int, generator: torch.Generator) -> Tensor:
    """Let wavy strands hang from the upper half of the head, outside of it: ``(strands, 40, 3)``."""
    height = torch.empty(strands).uniform_(-0.15, 1.0, generator=generator)
    angle = torch.empty(strands).uniform_(0.0, 2 * torch.pi, generator=generator)
    around = (1 - height**2).sqrt()
    normals = torch.stack([around * angle.cos(), -height, around * angle.sin()], dim=1)
    wave = 0.2 * torch.randn(strands, 3, generator=generator)
    point, direction = HEAD_RADIUS * normals, normalize(0.5 * normals + 0.6 * DOWN, dim=1)
    points = [point]
    for _ in range(SEGMENTS):
        jitter = 0.05 * torch.randn(strands, 3, generator=generator)
        direction = normalize(direction + 0.5 * DOWN + 0.35 * wave + jitter, dim=1)
        ahead = point + SEGMENT_LENGTH * direction
        distance = ahead.norm(dim=1, keepdim=True)
        ahead = torch.where(distance < 1.01 * HEAD_RADIUS, 1.01 * HEAD_RADIUS * ahead / distance, ahead)
        direction = normalize(ahead - point, dim=1)
        point = point + SEGMENT_LENGTH * direction
        points.append(point)
    return torch.stack(points, dim=1)


def _turn_x_to(directions: Tensor) -> Tensor:
    """Find the quaternions (wxyz) of the shortest rotations from the x axis to unit vectors."""
    x, y, z = directions.unbind(1)
    return normalize(torch.stack([1 + x, torch.zeros_like(x), -z, y], dim=1), dim=1)
