"""``.data`` files of the USC-HairSalon data set: polylines alone.

Little endian: int32 number of strands; for each, int32 number of points and so many times x, y, z as float32.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError
from dynhair.storage import atomic_file
from dynhair.strands.files.bounded import Cursor, read_bytes
from dynhair.strands.files.strand_file import StrandFile

_MOST = 2**31 - 1


def read_data(path: Path) -> StrandFile:
    """Read a ``.data`` file.

    Raises:
        DynhairError: it cannot be read, or its counts do not agree with its size.
    """
    content = read_bytes(path, "a .data file of strands")
    cursor = Cursor(content, path)
    strands = int(cursor.take("<i4"))
    if not 0 < strands <= len(content) // 16:  # a strand takes a count and a point at least
        raise DynhairError(
            f"it announces {strands} strands in {len(content)} bytes",
            path=path,
            expected="a .data file of strands, as in USC-HairSalon",
        )
    polylines = [cursor.take("<f4", int(cursor.take("<i4")), 3) for _ in range(strands)]
    cursor.end()
    counts = np.array([len(polyline) for polyline in polylines])
    return StrandFile.from_arrays(path, np.concatenate(polylines), counts)


def write_data(path: Path, strands: StrandFile) -> None:
    """Write a ``.data`` file; widths and colours have no place in it.

    Raises:
        DynhairError: there are more strands or points in a strand than it can count.
    """
    if max(len(strands.counts), int(strands.counts.max())) > _MOST:
        raise DynhairError("there are too many strands or points for a .data file", path=path, expected=f"{_MOST}")
    counts, points = strands.counts.numpy(), strands.points.numpy()
    words = np.empty(1 + len(counts) + 3 * len(points), "<i4")
    # Where the counts stand: each after the words of the strands before it.
    at = 1 + np.arange(len(counts)) + 3 * (np.cumsum(counts) - counts)
    is_point = np.ones(len(words), bool)
    is_point[0] = is_point[at] = False
    words[0], words[at], words[is_point] = len(counts), counts, points.astype("<f4").ravel().view("<i4")
    with atomic_file(path) as temporary:
        temporary.write_bytes(words.tobytes())
