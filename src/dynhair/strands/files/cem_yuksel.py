""".hair`` files, Cem Yuksel's format: polylines with optional thickness, transparency and colour.

Little endian. A header of 128 bytes: "HAIR"; uint32 strands, points, which arrays follow, segments of each strand if
there is no array of them; float32 thickness, transparency, red, green and blue of all points if there are no arrays of
them; 88 characters of text. Then the arrays, in this order, all but the points optional: uint16 segments of each
strand; float32 points; float32 thickness, transparency and colour of each point.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError
from dynhair.storage import atomic_file
from dynhair.strands.files.bounded import Cursor, read_bytes
from dynhair.strands.files.strand_file import StrandFile

_SEGMENTS, _POINTS, _THICKNESS, _TRANSPARENCY, _COLOUR = (1 << bit for bit in range(5))
_HEADER = np.dtype(
    [
        ("magic", "S4"),
        ("strands", "<u4"),
        ("points", "<u4"),
        ("arrays", "<u4"),
        ("segments", "<u4"),
        ("thickness", "<f4"),
        ("transparency", "<f4"),
        ("colour", "<f4", 3),
        ("text", "S88"),
    ]
)
# What the format's own library writes where nothing was said; any other value was meant.
_UNSAID = {"thickness": 1.0, "transparency": 0.0, "colour": (1.0, 1.0, 1.0)}


def read_hair(path: Path) -> StrandFile:
    """Read a ``.hair`` file.

    A thickness, transparency or colour given once for all points is given to each of them; the values by which the
    format's own library says nothing (1, 0 and white) are left out.

    Raises:
        DynhairError: it cannot be read, is of another kind, or its counts do not agree with one another or its size.
    """
    content = read_bytes(path, "a .hair file")
    if content[:4] != b"HAIR":
        raise DynhairError(f"it starts with {content[:4]!r}", path=path, expected="HAIR: a .hair file of Cem Yuksel's")
    cursor = Cursor(content, path)
    header = cursor.take(_HEADER)
    strands, points, arrays = (int(header[name]) for name in ("strands", "points", "arrays"))
    if not arrays & _POINTS:
        raise DynhairError("it has no points", path=path)
    if arrays & _SEGMENTS:
        counts = cursor.take("<u2", strands).astype(np.int64) + 1
    elif strands * (int(header["segments"]) + 1) == points:
        counts = np.broadcast_to(np.int64(header["segments"]) + 1, strands)
    else:
        raise DynhairError(f"{strands} strands of {header['segments']} segments are not its {points} points", path=path)
    found = {"points": cursor.take("<f4", points, 3)}
    for name, array, *shape in (
        ("thickness", _THICKNESS),
        ("transparency", _TRANSPARENCY),
        ("colour", _COLOUR, 3),
    ):
        if arrays & array:
            found[name] = cursor.take("<f4", points, *shape)
        elif np.any(header[name] != np.float32(_UNSAID[name])):
            found[name] = np.broadcast_to(header[name], (points, *shape))
    cursor.end()
    return StrandFile.from_arrays(
        path,
        found["points"],
        counts,
        widths=found.get("thickness"),
        transparencies=found.get("transparency"),
        colours=found.get("colour"),
    )


def write_hair(path: Path, strands: StrandFile) -> None:
    """Write a ``.hair`` file.

    Raises:
        DynhairError: there are more strands or points, or more points in a strand, than it can count.
    """
    counts = strands.counts.numpy()
    uniform = counts.min() == counts.max()
    if len(strands.points) > np.iinfo(np.uint32).max:
        raise DynhairError("there are too many points for a .hair file", path=path, expected="fewer than 2^32")
    if not uniform and counts.max() > np.iinfo(np.uint16).max + 1:
        raise DynhairError(
            f"a strand has {counts.max()} points",
            path=path,
            expected="at most 65,536 in a .hair file whose strands differ in their numbers of points",
            mend="resample the strands, or write a .npz file",
        )
    arrays = {
        _SEGMENTS: None if uniform else (counts - 1).astype("<u2"),
        _POINTS: strands.points,
        _THICKNESS: strands.widths,
        _TRANSPARENCY: strands.transparencies,
        _COLOUR: strands.colours,
    }
    header = np.zeros((), _HEADER)
    header["magic"], header["text"] = b"HAIR", b"dynhair"
    header["strands"], header["points"] = len(counts), len(strands.points)
    header["arrays"] = sum(bit for bit, array in arrays.items() if array is not None)
    header["segments"] = counts.max() - 1 if uniform else 0
    for name, value in _UNSAID.items():
        header[name] = value
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        file.write(header.tobytes())
        for array in arrays.values():
            if array is not None:
                written = array if isinstance(array, np.ndarray) else array.numpy().astype("<f4")
                file.write(written.tobytes())
