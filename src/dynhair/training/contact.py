"""Hair against the tracked surface of the frame, found out while the avatar is drawn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.losses import depth_loss, sample_strand_points
from dynhair.strands import MeshDistance, Roots
from dynhair.strands.collision import Nearest
from dynhair.threads import beside
from dynhair.training.surface import TrackedSurface

HEAD_FOLLOWS = 0.5
"""A face of the tracked surface is the head's, not the body's, where its vertices follow the head by more than this."""


class Contact(NamedTuple):
    """Hair and surface in one frame; without gradients but for the penetration.

    Attributes:
        penetration: the paper's ``L_penetr`` of points drawn at random.
        tracked: where the points that the head is held to lie, world, metres; None if there are none.
    """

    penetration: Float[Tensor, ""]
    tracked: Float[Tensor, "k 3"] | None


class SurfaceContact:
    """The tracked surface, moved from frame to frame.

    Args:
        surface: the mesh and its motion.
        frame: any of its frames.
        held: points of the surface that the head is held to; None for none.
        count: strand points that are kept outside of it.
        body: whether that holds for the body as well as for the head.
        device: the avatar's.
    """

    def __init__(
        self, surface: TrackedSurface, frame: int, held: Roots | None, count: int, *, body: bool, device: torch.device
    ) -> None:
        self._surface, self._held, self._count, self._device = surface, held, count, device
        self._mesh = MeshDistance(surface.vertices(frame).to(device), surface.faces)
        with_head = surface.follow[surface.faces].mean(1) > HEAD_FOLLOWS
        self._counted = None if body else with_head.to(device)

    def begin(self, frame: int, strands: Float[Tensor, "n l 3"], generator: torch.Generator) -> Callable[[], Contact]:
        """Begin to look for points inside the surface, on the CPU in a thread of its own.

        On a second core it takes no time, for drawing does not share all its work among threads.

        Args:
            frame: of the capture.
            strands: posed, world, metres.
            generator: of random numbers, on the CPU.

        Returns:
            What waits for the result.
        """
        points = sample_strand_points(strands, self._count, generator=generator)
        find = partial(self._find, frame, points.detach())  # the gradient is this thread's
        found = beside(find) if self._device.type == "cpu" else find

        def contact() -> Contact:
            nearest, tracked = found()
            return Contact(depth_loss(points, nearest, self._counted), tracked)

        return contact

    def _find(self, frame: int, points: Float[Tensor, "p 3"]) -> tuple[Nearest, Float[Tensor, "k 3"] | None]:
        with torch.no_grad():
            vertices = self._surface.vertices(frame).to(self._device)
            self._mesh.refit(vertices)
            return self._mesh.nearest(points), None if self._held is None else self._held.positions(vertices)
