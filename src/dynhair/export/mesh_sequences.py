"""The moving head mesh as numbered ``.obj`` files, one a frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int64

from dynhair.errors import DynhairError
from dynhair.export.strand_motion import StrandMotion
from dynhair.export.strand_sequences import numbered
from dynhair.storage import atomic_file


def write_mesh_sequence(folder: Path, motion: StrandMotion, *, first: int = 0) -> list[Path]:
    """Write a file for each frame: world, metres, y up, faces counter-clockwise seen from outside.

    Args:
        folder: where; files in it are overwritten.
        motion: whose head.
        first: number of the first frame.

    Returns:
        The files, in order.

    Raises:
        DynhairError: the motion has no head mesh, or a frame is not what it says.
    """
    if motion.head_faces is None:
        raise DynhairError("there is no head mesh to write", path=folder, mend="leave the format `head` out")
    paths = []
    for number, frame in enumerate(motion, first):
        assert frame.head is not None  # the motion checks it
        paths.append(numbered(folder, number, "obj"))
        _write_obj(paths[-1], frame.head, motion.head_faces)
    return paths


def _write_obj(path: Path, vertices: Float32[np.ndarray, "v 3"], faces: Int64[np.ndarray, "t 3"]) -> None:
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        file.write(b"# metres, y up\n")
        np.savetxt(file, vertices, "v %.9g %.9g %.9g")
        np.savetxt(file, faces + 1, "f %d %d %d")
