"""Rays against a triangle mesh."""

# Warp's annotations are calls, and its stubs do not declare the fields of a query.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from typing import no_type_check

import numpy as np
import warp as wp

from dynhair.camera import Camera
from dynhair.render.warp_runtime import warp

wp.set_module_options({"enable_backward": False})


class RayCaster:
    """Casts rays on a mesh.

    Args:
        vertices: (V, 3) positions.
        faces: (F, 3) triangles, counter-clockwise seen from outside.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        warp()
        self._mesh = wp.Mesh(
            points=wp.array(vertices.astype(np.float32), dtype=wp.vec3, device="cpu"),
            indices=wp.array(faces.astype(np.int32).ravel(), dtype=int, device="cpu"),
        )

    def cast(self, origins: np.ndarray, directions: np.ndarray, reach: float = 1e3) -> tuple[np.ndarray, np.ndarray]:
        """The first triangle that each ray meets.

        Args:
            origins: (n, 3) where the rays start.
            directions: (n, 3) of unit length.
            reach: length of the rays.

        Returns:
            (n,) triangles, -1 where there is none, and (n, 3) barycentric coordinates of the points met.
        """
        count = len(origins)
        found = wp.empty(count, dtype=int, device="cpu")
        places = wp.zeros(count, dtype=wp.vec3, device="cpu")
        rays = [wp.array(part.astype(np.float32), dtype=wp.vec3, device="cpu") for part in (origins, directions)]
        wp.launch(_first_hit, dim=count, inputs=[self._mesh.id, *rays, reach], outputs=[found, places], device="cpu")
        return found.numpy(), places.numpy().astype(np.float64)

    def through_pixels(self, camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The triangle that shows at each of (n, 2) pixels: as :meth:`cast`."""
        w2c, intrinsics = camera.w2c.double().numpy(), camera.K.double().numpy()
        local = np.linalg.solve(intrinsics, np.c_[pixels, np.ones(len(pixels))].T).T
        directions = local @ w2c[:, :3]
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return self.cast(np.broadcast_to(camera.centre.numpy(), directions.shape), directions)


@no_type_check  # its annotations are Warp's
@wp.kernel
def _first_hit(
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    reach: float,
    faces: wp.array(dtype=int),
    barycentric: wp.array(dtype=wp.vec3),
):
    index = wp.tid()
    query = wp.mesh_query_ray(mesh, origins[index], directions[index], reach)
    faces[index] = -1
    if query.result:
        faces[index] = query.face
        barycentric[index] = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)
