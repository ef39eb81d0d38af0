"""Motion continued beyond its ends, so that filters and splines know no ends.

Each end is a centre of symmetry: what went before it comes again, turned round. Velocity is continuous there, and
acceleration zero.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64


def reflected_times(times: Float64[np.ndarray, " f"], count: int) -> Float64[np.ndarray, " n"]:
    """Continue instants by ``count`` at either end."""
    return reflected_vectors(times[:, None], count)[:, 0]


def reflected_vectors(values: Float64[np.ndarray, "f d"], count: int) -> Float64[np.ndarray, "n d"]:
    """Continue values by ``count`` at either end, at most as many as there are less one."""
    before = 2 * values[0] - values[count:0:-1]
    after = 2 * values[-1] - values[-2 : -2 - count : -1]
    return np.concatenate([before, values, after])


def reflected_rotations(rotations: Float64[np.ndarray, "f 3 3"], count: int) -> Float64[np.ndarray, "n 3 3"]:
    """Continue rotations by ``count`` at either end: on the geodesic from the k-th to the end, as far beyond it."""
    first, last = rotations[0], rotations[-1]
    before = first @ rotations[count:0:-1].transpose(0, 2, 1) @ first
    after = last @ rotations[-2 : -2 - count : -1].transpose(0, 2, 1) @ last
    return np.concatenate([before, rotations, after])
