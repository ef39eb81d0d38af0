"""Identities that change a head's shape and size, and neither turn nor move its face."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int64


def aligned_to_face(
    modes: Float[np.ndarray, "k v 3"], mean: Float[np.ndarray, "v 3"], face: Int64[np.ndarray, " n"]
) -> Float[np.ndarray, "k v 3"]:
    """Take from each mode the small turn and shift that come closest to what it does to the face.

    Statistics of bodies bend the neck and carry the face along: some modes of a standard deviation each turn it by a
    degree or more. A tracker that sees the face alone could then trade the head's rotation for an unlikely identity. It
    is the head's own rotation and position that are to say where the face is.

    Args:
        modes: offsets of all vertices.
        mean: the average head.
        face: vertices by which the face is held.
    """
    motions = _small_motions(mean, mean[face].mean(0))
    at_face = motions[:, face].reshape(len(motions), -1).T
    fitted, *_ = np.linalg.lstsq(at_face, modes[:, face].reshape(len(modes), -1).T, rcond=None)
    return modes - np.einsum("uk,uvc->kvc", fitted, motions)


def _small_motions(points: Float[np.ndarray, "v 3"], centre: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "6 v 3"]:
    """How points move with a small turn about a centre (3), and with a shift (3)."""
    arms, axes = points - centre, np.eye(3)[:, None]
    return np.concatenate([np.cross(axes, arms), np.broadcast_to(axes, (3, *arms.shape))])
