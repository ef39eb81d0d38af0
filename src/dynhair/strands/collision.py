"""Signed distances from points to a mesh, and points kept outside of it."""

from __future__ import annotations

import contextlib
import threading
from functools import partial
from typing import NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor

from dynhair.render.warp_runtime import warp
from dynhair.threads import run, shares

_compiling = threading.Lock()


@runtime_checkable
class Obstacle(Protocol):
    """What strands must stay outside of, such as :class:`MeshDistance`."""

    def query(self, points: Float[Tensor, "p 3"]) -> tuple[Float[Tensor, " p"], Float[Tensor, "p 3"]]:
        """Signed distances (negative inside) and closest surface points, metres."""
        ...


def push_out(points: Float[Tensor, "p 3"], obstacle: Obstacle, clearance: float) -> Float[Tensor, "p 3"]:
    """Points moved straight away from the surface to at least ``clearance`` metres outside of the obstacle."""
    distance, closest = obstacle.query(points)
    # Inside, the direction from the closest point turns inwards.
    outwards = (points - closest) * torch.where(distance < 0, -1.0, 1.0)[:, None]
    normal = torch.nn.functional.normalize(outwards, dim=1)
    return points + (clearance - distance).clamp_min(0.0)[:, None] * normal


class Nearest(NamedTuple):
    """What of a mesh is nearest to points; without gradients.

    Attributes:
        distance: to the surface, metres, negative inside the mesh; ``nan`` for a point that is not finite.
        position: of the nearest surface point, metres.
        face: index of the face that it lies on, -1 for a point that is not finite.
    """

    distance: Float[Tensor, " p"]
    position: Float[Tensor, "p 3"]
    face: Int[Tensor, " p"]


class MeshDistance:
    """Signed distance to a triangle mesh that may move, but keeps its topology.

    A point is inside where the mesh's winding number exceeds one half. Tracked heads ask for that: they are open below
    the shoulders, arms press into the torso, eyeballs and teeth are closed surfaces within the head. For points within
    a few centimetres of such a head (5,992 vertices), compared with exact winding numbers in float64, the sign of the
    nearest triangle's normal is wrong for 9% around neck, shoulders and arms and 2.5% around the face, by up to 8 cm;
    ray parity for 3% and 0.04%; Warp's approximate winding number for 0.03% of all, at the price of 31 ms for 10,000
    points on one core (normals 14, parity 24). The opening below ends as if a membrane closed it; within millimetres of
    that membrane the sign is not reliable.

    Queries and refits of one object wait for one another, so threads can share it; threads that are to query at the
    same time need an object each.

    Args:
        vertices: vertex positions, metres.
        faces: triangles, counter-clockwise seen from outside.
    """

    def __init__(self, vertices: Float[Tensor, "v 3"], faces: Int[Tensor, "f 3"]) -> None:
        wp = warp()
        self._lock = threading.Lock()
        self._device = vertices.device
        # Warp's arrays are views of these tensors, which must live as long as the mesh.
        self._vertices = vertices.detach().to(torch.float32, copy=True).contiguous()
        self._faces = faces.to(self._device, torch.int32, copy=True).flatten()
        with _compiling, self._stream():
            from dynhair.strands import mesh_query

            wp.load_module(mesh_query, device=wp.device_from_torch(self._device))
            self._mesh = wp.Mesh(
                points=wp.from_torch(self._vertices, dtype=wp.vec3),
                indices=wp.from_torch(self._faces),
                support_winding_number=True,
            )

    def refit(self, vertices: Float[Tensor, "v 3"]) -> None:
        """Move the mesh's vertices."""
        with self._lock, self._stream():
            self._vertices.copy_(vertices.detach())
            self._mesh.refit()

    def query(self, points: Float[Tensor, "p 3"]) -> tuple[Float[Tensor, " p"], Float[Tensor, "p 3"]]:
        """Find the surface point nearest to each point.

        Args:
            points: where to look, metres, in the vertices' frame.

        Returns:
            Distances, negative inside the mesh, and the nearest surface points; float32 and without gradients. A point
            that is not finite has distance ``nan``.
        """
        return self.nearest(points)[:2]

    def nearest(self, points: Float[Tensor, "p 3"]) -> Nearest:
        """Find the surface point nearest to each point, and its face.

        Args:
            points: where to look, metres, in the vertices' frame.
        """
        points = points.detach().to(self._device, torch.float32).contiguous()
        found = Nearest(
            distance=torch.empty_like(points[:, 0]),
            position=torch.empty_like(points),
            face=torch.empty(len(points), dtype=torch.int32, device=self._device),
        )
        # On a CPU a launch keeps to one thread.
        parts = shares(len(points)) if self._device.type == "cpu" else [(0, len(points))]
        with self._lock, self._stream():
            run(partial(self._find, points, found, *places) for places in parts)
        return found

    def _find(self, points: Float[Tensor, "p 3"], found: Nearest, first: int, last: int) -> None:
        from dynhair.strands.mesh_query import signed_distance

        wp = warp()
        distance, position, face = (part[first:last] for part in found)
        wp.launch(
            signed_distance,
            dim=last - first,
            inputs=[self._mesh.id, wp.from_torch(points[first:last], dtype=wp.vec3)],
            outputs=[wp.from_torch(distance), wp.from_torch(position, dtype=wp.vec3), wp.from_torch(face)],
            device=wp.device_from_torch(self._device),
        )

    def _stream(self) -> contextlib.AbstractContextManager[object]:
        """On CUDA, keep Warp's work in order with torch's."""
        if self._device.type != "cuda":
            return contextlib.nullcontext()
        wp = warp()
        return wp.ScopedStream(wp.stream_from_torch(torch.cuda.current_stream(self._device)))
