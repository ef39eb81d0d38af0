"""Vertices and triangles of Wavefront OBJ files, in the order of the file.

Own reader: the mesh libraries bring much with them and merge or reorder vertices unless they are told not to, and a
morphable model is nothing but the order of its vertices.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64

from dynhair.errors import DynhairError


def read_vertices(path: Path, count: int) -> Float[np.ndarray, "v 3"]:
    """The first `count` vertices.

    Raises:
        DynhairError: the file is missing or has fewer.
    """
    lines = [line[2:] for line in _lines(path) if line.startswith(b"v ")]
    try:
        vertices = (
            np.loadtxt(lines[:count], dtype=np.float64, ndmin=2, usecols=(0, 1, 2)) if lines else np.empty((0, 3))
        )
    except ValueError as error:
        raise DynhairError("its vertices are not three numbers each", path=path) from error
    if len(vertices) < count:
        raise DynhairError(f"it has {len(vertices)} vertices", path=path, expected=f"at least {count}")
    return vertices


def read_triangles(path: Path) -> Int64[np.ndarray, "f 3"]:
    """Vertex indices from 0; faces of more corners are fanned.

    Raises:
        DynhairError: the file is missing, or a face is not made of vertices by number.
    """
    triangles = []
    try:
        for line in _lines(path):
            if line.startswith(b"f "):
                corners = [int(corner.split(b"/")[0]) - 1 for corner in line.split()[1:]]
                triangles += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
    except ValueError as error:
        raise DynhairError("its faces are not made of vertices by number", path=path) from error
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _lines(path: Path) -> list[bytes]:
    try:
        return path.read_bytes().split(b"\n")
    except OSError as error:
        raise DynhairError("the file cannot be read", path=path, expected="a Wavefront OBJ file") from error
