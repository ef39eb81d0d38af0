"""The Warp kernel behind :class:`dynhair.strands.MeshDistance`."""

# Warp's annotations are calls, and its stubs do not declare the fields of a query.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from typing import no_type_check

import warp as wp

wp.set_module_options({"enable_backward": False})

ACCURACY = wp.constant(1.0)  # of winding numbers; Warp's own default of 2 takes three times as long
REACH = wp.constant(1e6)  # metres: any surface point, however far


@no_type_check  # its annotations are Warp's
@wp.kernel
def signed_distance(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    distances: wp.array(dtype=float),
    closest: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=int),
):
    index = wp.tid()
    point = points[index]
    query = wp.mesh_query_point_sign_winding_number(mesh, point, REACH, ACCURACY)
    if query.result:
        position = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        distances[index] = query.sign * wp.length(position - point)
        closest[index] = position
        faces[index] = query.face
    else:  # the point is not finite
        distances[index] = wp.nan
        closest[index] = point
        faces[index] = -1
