"""Views as preprocessing would leave them: some of them only, with faults in masks, directions and geometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from torch import Tensor
from torch.nn import functional

from dynhair.camera import Camera
from dynhair.prior.dataset import FRONT_VIEWS, StyleViews
from dynhair.prior.evidence import Evidence, gather_evidence
from dynhair.strands.scalp_map import ScalpFrame

_FRONT_ARC = 50.0
_TURN, _SHIFT, _STRETCH = math.radians(1.5), 0.004, 0.03  # standard deviations of the head's pose and size
_DEPTH = 0.004
_LOST_BLOBS = 0.15
_WITHOUT_DIRECTIONS = 0.03


@dataclass(frozen=True)
class Maps:
    """What :func:`dynhair.prior.evidence.gather_evidence` takes."""

    frame: ScalpFrame
    cameras: list[Camera]
    hair: Float[Tensor, "v h w"]
    direction: Float[Tensor, "v h w 2"]
    body_depth: Float[Tensor, "v h w"]

    @classmethod
    def of(cls, style: StyleViews, views: Sequence[int]) -> Maps:
        """Some views of a style of the training set, without faults."""
        chosen = list(views)
        return cls(
            style.frame,
            [style.cameras[index] for index in chosen],
            torch.from_numpy(style.hair[chosen]).float() / 255,
            torch.from_numpy(style.direction[chosen]).float() / 127,
            torch.from_numpy(style.body_depth[chosen]).float(),
        )

    def evidence(self) -> Evidence:
        """What they say about the hair."""
        return gather_evidence(self.frame, self.cameras, self.hair, self.direction, self.body_depth)


def random_views(style: StyleViews, random: np.random.Generator) -> list[int]:
    """Draw the views of a capture: a few before the face, alone or with a part of the ring; or the ring alone."""
    front, ring = list(range(FRONT_VIEWS)), list(range(FRONT_VIEWS, len(style.cameras)))
    kind = random.random()
    if kind < 0.4:
        before = front + [index for index in ring if abs(_azimuth(style, index)) < _FRONT_ARC]
        return random.choice(before, random.integers(2, min(len(before), 8) + 1), replace=False).tolist()
    if kind < 0.65:
        return front + random.choice(ring, random.integers(3, len(ring) // 2), replace=False).tolist()
    if kind < 0.8:
        return ring[:: int(random.integers(1, 4))]
    return front + ring


def disturbed(maps: Maps, random: np.random.Generator) -> Maps:
    """Put in faults, a different amount each time, sometimes none."""
    torch_random = torch.Generator().manual_seed(int(random.integers(1 << 62)))
    hair = _faulty_mask(maps.hair, random, torch_random)
    direction = _faulty_direction(maps.direction, random, torch_random)
    # Directions are weighted by the mask they come with.
    direction = direction * (hair / maps.hair.clamp_min(1e-3)).clamp(0, 1)[..., None]
    depth = maps.body_depth + random.normal(0, _DEPTH)
    rotation = torch.from_numpy(Rotation.from_rotvec(random.normal(0, _TURN, 3)).as_matrix()).float()
    shift = torch.from_numpy(random.normal(0, _SHIFT, 3)).float()
    centre = maps.frame.centre
    cameras = []
    for camera in maps.cameras:
        R, t = camera.w2c[:, :3], camera.w2c[:, 3]
        # The head's true points x are taken for rotation^T (x - centre) + centre - shift.
        moved = torch.cat([R @ rotation, (R @ (centre - rotation @ (centre - shift)) + t)[:, None]], 1)
        cameras.append(replace(camera, w2c=moved))
    frame = replace(maps.frame, radius=maps.frame.radius * (1 + random.normal(0, _STRETCH)))
    return Maps(frame, cameras, hair, direction, depth)


def _faulty_mask(hair: Tensor, random: np.random.Generator, torch_random: torch.Generator) -> Tensor:
    """A mask with another outline here and there, softer or harder; now and then a piece of it is lost."""
    soft = functional.avg_pool2d(hair[:, None], 3, 1, 1)[:, 0]
    outline = random.uniform(0, 0.8) * (_blobs(hair, 12, torch_random) - 0.5)
    limit, hardness = random.uniform(0.35, 0.65), random.uniform(1, 6)
    hair = ((soft + outline - limit) * hardness + 0.5).clamp(0, 1)
    if random.random() < _LOST_BLOBS:
        hair = hair * (_blobs(hair, 5, torch_random) < random.uniform(0.7, 0.95))
    return hair


def _faulty_direction(direction: Tensor, random: np.random.Generator, torch_random: torch.Generator) -> Tensor:
    """Directions that are off by pieces and by pixels, and coherent in places only."""
    if random.random() < _WITHOUT_DIRECTIONS:
        return torch.zeros_like(direction)
    maps = direction[..., 0]
    angle = 2 * math.radians(random.uniform(0, 30)) * torch.randn(len(maps), 1, 12, 12, generator=torch_random)
    turn = functional.interpolate(torch.cat([angle.cos(), angle.sin()], 1), maps.shape[1:], mode="bilinear")
    (c, s), (cosine, sine) = turn.unbind(1), direction.unbind(-1)
    turned = torch.stack([cosine * c - sine * s, cosine * s + sine * c], -1)
    rough = random.uniform(0, 0.5) * torch.randn(direction.shape, generator=torch_random)
    turned = torch.addcmul(turned, rough, direction.norm(dim=-1, keepdim=True))
    least = random.uniform(-0.8, 1)
    coherence = (least + (1 - least) * _blobs(maps, 16, torch_random)).clamp_min(0)
    return turned * coherence[..., None]


def _blobs(like: Tensor, cells: int, random: torch.Generator) -> Float[Tensor, "v h w"]:
    """Smooth noise in [0, 1]."""
    coarse = torch.rand(len(like), 1, cells, cells, generator=random)
    return functional.interpolate(coarse, like.shape[1:], mode="bilinear")[:, 0]


def _azimuth(style: StyleViews, view: int) -> float:
    x, _, z = (style.cameras[view].centre - style.frame.centre).tolist()
    return math.degrees(math.atan2(x, z))
