"""``.ply`` files of strands: vertices and the edges between them.

Own reader: strands are two plain tables, and NumPy reads those; plyfile takes memory for the rows that a header
announces before it knows that they are there.

Ours are binary and little endian: ``vertex`` with x, y, z and, where known, width, transparency, red, green and blue,
all float32; ``edge`` with vertex1 and vertex2, each edge from a point to the next one of its strand. Programs that draw
edges, such as Blender and MeshLab, show them as lines.

Read as well: ASCII and big endian, colours as bytes, and the vertices without edges that research code writes, strand
by strand; see :func:`_guessed_counts`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError
from dynhair.storage import atomic_file
from dynhair.strands.files.bounded import Cursor, read_bytes
from dynhair.strands.files.strand_file import StrandFile

_TYPES = {
    **dict(zip(("char", "uchar", "short", "ushort", "int", "uint", "float", "double"), "bBhHiIfd", strict=True)),
    **dict(zip(("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"), "bBhHiIfd", strict=True)),
}
_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_LENGTH_COMMENT = "points_per_strand"
_USUAL_LENGTHS = (100, 200)
_JUMP = 5.0  # times the strand's median segment
_MOST = 0.9  # of the strands


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)


def read_ply(path: Path) -> StrandFile:
    """Read a ``.ply`` file of polylines, or of plain points whose strands can be told from one another.

    Raises:
        DynhairError: it cannot be read, holds a mesh, ends too early, or does not tell where strands end.
    """
    content = read_bytes(path, "a .ply file of strands")
    try:
        return _strands(content, path)
    except (ValueError, LookupError, FloatingPointError) as error:
        raise DynhairError(f"it is malformed ({error})", path=path, expected="a .ply file of strands") from None


def write_ply(path: Path, strands: StrandFile) -> None:
    """Write a ``.ply`` file of polylines.

    Raises:
        DynhairError: there are more points than it can number.
    """
    count = len(strands.points)
    if count > np.iinfo(np.int32).max:
        raise DynhairError("there are too many points for a .ply file", path=path, expected="fewer than 2^31")
    columns = dict(zip("xyz", strands.points.T, strict=True))
    if strands.widths is not None:
        columns["width"] = strands.widths
    if strands.transparencies is not None:
        columns["transparency"] = strands.transparencies
    if strands.colours is not None:
        columns.update(zip(("red", "green", "blue"), strands.colours.T, strict=True))
    vertices = np.empty(count, [(name, "<f4") for name in columns])
    for name, values in columns.items():
        vertices[name] = values.numpy()
    first = np.delete(np.arange(count, dtype="<i4"), np.cumsum(strands.counts.numpy()) - 1)
    edges = np.stack([first, first + 1], axis=1)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment hair strands: each edge joins a point to the next one of its strand",
        f"element vertex {count}",
        *(f"property float {name}" for name in columns),
        f"element edge {len(edges)}",
        "property int vertex1",
        "property int vertex2",
        "end_header",
    ]
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(vertices.tobytes())
        file.write(edges.tobytes())


def _strands(content: bytes, path: Path) -> StrandFile:
    lines, start = _header(content)
    tables = _tables(content[start:], lines, path)
    vertices = tables["vertex"]
    names = set(vertices.dtype.names or ())
    points = _columns(vertices, "x", "y", "z")
    told = [words[2] for words in lines if words[:2] == ["comment", _LENGTH_COMMENT]]
    if "edge" in tables:
        counts = _joined_counts(tables["edge"], len(points), path)
    elif told:
        strands, rest = divmod(len(points), int(told[0]))
        if rest or strands < 0:
            raise ValueError(f"{len(points)} points are not strands of {told[0]}")
        counts = np.full(strands, int(told[0]))
    else:
        counts = _guessed_counts(points, path)
    colours = _columns(vertices, "red", "green", "blue") if {"red", "green", "blue"} <= names else None
    if colours is not None and colours.dtype.kind == "u":
        colours = colours / np.iinfo(colours.dtype).max
    return StrandFile.from_arrays(
        path,
        points,
        counts,
        widths=vertices["width"] if "width" in names else None,
        transparencies=vertices["transparency"] if "transparency" in names else None,
        colours=colours,
    )


def _header(content: bytes) -> tuple[list[list[str]], int]:
    """The words of the header's lines, and where the body starts."""
    if not content.startswith(b"ply"):
        raise ValueError(f"it starts with {content[:4]!r}, not with ply")
    end = content.index(b"end_header")
    return [line.split() for line in content[:end].decode("ascii").splitlines()], content.index(b"\n", end) + 1


def _tables(body: bytes, lines: list[list[str]], path: Path) -> dict[str, np.ndarray]:
    order, elements = "", list[_Element]()
    for words in lines:
        if words[:1] == ["format"]:
            order = _BYTE_ORDERS[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2])))
        elif words[:1] == ["property"]:
            kind = "" if words[1] == "list" else order + _TYPES[words[1]]
            elements[-1].properties.append((words[-1], kind))
    if not order:
        raise ValueError("it has no format line")
    for element in elements:
        if element.count and not all(kind for _, kind in element.properties):
            raise DynhairError(
                f"it holds {element.count} of {element.name}, which are lists: a mesh, not strands",
                path=path,
                mend="export the strands as polylines, or as points",
            )
    elements = [element for element in elements if (element.count and element.properties) or element.name == "edge"]
    if order == _BYTE_ORDERS["ascii"]:
        return _ascii_tables(body, elements, path)
    cursor = Cursor(body, path)
    tables = {element.name: cursor.take(np.dtype(element.properties), element.count) for element in elements}
    cursor.end()
    return tables


def _ascii_tables(body: bytes, elements: list[_Element], path: Path) -> dict[str, np.ndarray]:
    numbers = np.fromiter(map(float, body.split()), np.float64)
    cursor = Cursor(numbers.tobytes(), path)
    tables = {}
    for element in elements:
        rows = cursor.take(np.float64, element.count, len(element.properties))
        tables[element.name] = np.empty(element.count, np.dtype(element.properties))
        for (name, _), column in zip(element.properties, rows.T, strict=True):
            with np.errstate(over="ignore", invalid="raise"):
                tables[element.name][name] = column
    cursor.end()
    return tables


def _columns(table: np.ndarray, *names: str) -> np.ndarray:
    return np.stack([table[name] for name in names], axis=1)


def _joined_counts(edges: np.ndarray, points: int, path: Path) -> np.ndarray:
    """Points of each strand, of which edges join each to the next."""
    ends = _columns(edges, "vertex1", "vertex2")
    if ends.dtype.kind not in "iu":
        raise ValueError(f"its edges are {ends.dtype}")
    low, high = np.sort(ends.astype(np.int64), axis=1).T
    if ((low < 0) | (high >= points) | (high - low != 1)).any():
        raise DynhairError(
            "its edges do not join each point to the next one of a strand",
            path=path,
            expected="vertices strand by strand, in order from one end to the other",
            mend="export the strands again without merging or reordering their points",
        )
    ends_strand = np.ones(points, bool)
    ends_strand[low] = False
    return np.diff(np.flatnonzero(ends_strand), prepend=-1)


def _guessed_counts(points: np.ndarray, path: Path) -> np.ndarray:
    """Points of each strand, told from where they jump.

    The research code that writes plain points has strands of 100 or of 200. Of these lengths just one has to fit: in
    nine of ten strands, the step to the next strand is more than five times the median segment, and no segment is.
    """
    fitting = [length for length in _USUAL_LENGTHS if _fits(points, length)]
    if len(fitting) != 1:
        raise DynhairError(
            f"its {len(points)} points have no edges, and do not tell where strands end",
            path=path,
            expected="edges, or strands of 100 or of 200 points one after another",
            mend=f"put the line 'comment {_LENGTH_COMMENT} 100', with the right number, after the header's first",
        )
    return np.full(len(points) // fitting[0], fitting[0])


def _fits(points: np.ndarray, length: int) -> bool:
    if not len(points) or len(points) % length:
        return False
    strands = points.astype(np.float64).reshape(-1, length, 3)
    segments = np.linalg.norm(np.diff(strands, axis=1), axis=2)
    jump = _JUMP * np.median(segments, axis=1)
    steps_to_next = np.linalg.norm(strands[1:, 0] - strands[:-1, -1], axis=1)
    whole = segments.max(axis=1) <= jump
    whole[:-1] &= steps_to_next > jump[:-1]
    return bool(whole.mean() >= _MOST)
