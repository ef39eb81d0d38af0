"""Signed distance to head, neck and shoulders on a grid: what thousands of hairstyles are draped over."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional

from dynhair.strands.collision import MeshDistance

_VOXEL = 0.006
_REACH = torch.tensor([0.27, 0.04, 0.25])
_DEPTH = 0.55
_RIM = 0.05


@dataclass(frozen=True)
class HeadField:
    """A trilinear signed distance with its gradient; mesh queries are too slow for the many steps of growing hair.

    The body goes on straight downwards from where an open mesh ends, so that long hair does not swing in below it.

    Attributes:
        volume: distance, negative inside, and its gradient, on a grid with axes z, y, x.
        low: the grid's first point, head frame, metres.
        high: its last point.
    """

    volume: Float[Tensor, "4 d h w"]
    low: Float[Tensor, "3"]
    high: Float[Tensor, "3"]

    @classmethod
    def of(cls, vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"]) -> HeadField:
        """Measure a head's mesh, about half a million points around the place below its top.

        Args:
            vertices: head, neck and shoulders in the head frame, metres.
            faces: triangles, counter-clockwise seen from outside.
        """
        vertices = vertices.detach().float().cpu()
        top = vertices[vertices[:, 1].argmax()]
        low, high = top - _REACH, top + _REACH
        # At an open mesh's rim inside and outside cannot be told apart.
        low[1] = torch.maximum(top[1] - _DEPTH, vertices[:, 1].min() + _RIM)
        counts = ((high - low) / _VOXEL).ceil().long() + 1
        axes = [torch.linspace(float(low[k]), float(high[k]), int(counts[k])) for k in range(3)]
        z, y, x = torch.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        distance, _ = MeshDistance(vertices, faces.cpu()).query(torch.stack([x, y, z], -1).reshape(-1, 3))
        distance = distance.view(x.shape)
        slopes = torch.gradient(distance, spacing=[axes[2], axes[1], axes[0]])
        return cls(torch.stack([distance, slopes[2], slopes[1], slopes[0]]), low, high)

    def query(self, points: Float[Tensor, "*n 3"]) -> tuple[Float[Tensor, "*n"], Float[Tensor, "*n 3"]]:
        """Signed distances, metres, and unit outward directions; points beyond the grid get those of its border."""
        place = 2 * (points.reshape(-1, 3) - self.low) / (self.high - self.low) - 1
        found = functional.grid_sample(
            self.volume[None], place[None, None, None], mode="bilinear", padding_mode="border", align_corners=True
        )[0, :, 0, 0]
        normals = functional.normalize(found[1:].T, dim=1)
        return found[0].view(points.shape[:-1]), normals.view(points.shape)

    def push_out(self, points: Float[Tensor, "*n 3"], clearance: Float[Tensor, "*n"]) -> Float[Tensor, "*n 3"]:
        """Points moved along the gradient to at least ``clearance`` metres outside."""
        distance, normal = self.query(points)
        return points + (clearance - distance).clamp_min(0)[..., None] * normal
