"""Meshes made on the spot."""

from __future__ import annotations

import torch


def sphere(radius: float = 0.1, rings: int = 24, sides: int = 32) -> tuple[torch.Tensor, torch.Tensor]:
    """A closed sphere about the y axis: vertices (V, 3) and faces (F, 3), counter-clockwise from outside."""
    polar = torch.linspace(0, torch.pi, rings + 1, dtype=torch.float64)[1:-1, None]
    around = torch.arange(sides, dtype=torch.float64)[None] * (2 * torch.pi / sides)
    ring = torch.stack(
        torch.broadcast_tensors(polar.sin() * around.cos(), polar.cos(), -polar.sin() * around.sin()), dim=-1
    )
    poles = torch.tensor([[0.0, 1, 0], [0.0, -1, 0]], dtype=torch.float64)
    vertices = torch.cat([ring.reshape(-1, 3), poles]) * radius
    top, bottom = len(vertices) - 2, len(vertices) - 1
    faces = []
    for side in range(sides):
        beside = (side + 1) % sides
        faces.append([top, side, beside])
        last = (rings - 2) * sides
        faces.append([bottom, last + beside, last + side])
        for row in range(0, last, sides):
            a, b, c, d = row + side, row + beside, row + sides + side, row + sides + beside
            faces += [[a, c, d], [a, d, b]]
    return vertices.float(), torch.tensor(faces)
