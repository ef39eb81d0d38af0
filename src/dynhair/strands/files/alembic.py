"""``.abc`` files: curves of an Alembic archive, at their first sample, moved by the transforms above them.

Alembic knows neither unit nor up axis: points are in the scene's.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dynhair.errors import DynhairError
from dynhair.strands.files.bounded import read_bytes
from dynhair.strands.files.curves import Curves, joined_curves
from dynhair.strands.files.ogawa import HDF5_MAGIC, Compound, Object, open_archive
from dynhair.strands.files.strand_file import StrandFile

_CUBIC, LINEAR = 0, 1
OPEN = 0
_BASES = ("linear", "bezier", "bspline", "catmullRom")
_DEEPEST = 100


def _rotation(axis: np.ndarray, degrees: float) -> np.ndarray:
    matrix, length = np.eye(4), np.linalg.norm(axis)
    if length > 0:
        matrix[:3, :3] = Rotation.from_rotvec(degrees / length * axis, degrees=True).as_matrix()
    return matrix


def _translation(values: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = values
    return matrix


# What the numbers of each kind of operation mean, as matrices for column vectors.
_OPERATIONS: tuple[tuple[int, Callable[[np.ndarray], np.ndarray]], ...] = (
    (3, lambda scale: np.diag([*scale, 1.0])),
    (3, _translation),
    (4, lambda turn: _rotation(turn[:3], turn[3])),
    (16, lambda rows: rows.reshape(4, 4).T),
    (1, lambda degrees: _rotation(np.eye(3)[0], degrees[0])),
    (1, lambda degrees: _rotation(np.eye(3)[1], degrees[0])),
    (1, lambda degrees: _rotation(np.eye(3)[2], degrees[0])),
)


def read_abc(path: Path) -> StrandFile:
    """Read the curves of an Alembic archive.

    Raises:
        DynhairError: it cannot be read, is stored as HDF5, or holds no curves.
    """
    content = read_bytes(path, "an Alembic file")
    if content.startswith(HDF5_MAGIC):
        raise DynhairError(
            "it is an Alembic file of the old kind, stored as HDF5",
            path=path,
            expected="Ogawa, which all programs have written since 2014",
            mend="convert it: abcconvert -toOgawa OLD.abc NEW.abc",
        )
    curves: list[Curves] = []
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # what is not finite is refused as such
            _collect(open_archive(content), np.eye(4), curves, 0)
    except (ValueError, LookupError, struct.error) as error:
        raise DynhairError(f"it is damaged ({error})", path=path, expected="an Alembic file") from None
    return joined_curves(path, curves)


def _collect(node: Object, above: np.ndarray, curves: list[Curves], depth: int) -> None:
    """Put the curves at and below an object into a list."""
    if depth > _DEEPEST:
        raise ValueError(f"objects lie {depth} deep")
    matrix = above
    if node.schema.startswith("AbcGeom_Xform"):
        matrix = _transform(node.properties.compound(".xform"), above)
    elif node.schema.startswith("AbcGeom_Curve"):
        curves.append(_curves(node.properties.compound(".geom"), matrix))
    for child in node.children():
        _collect(child, matrix, curves, depth + 1)


def _transform(properties: Compound, above: np.ndarray) -> np.ndarray:
    """Matrix of column vectors from below a transform to the scene."""
    inherits = properties.first(".inherits") if ".inherits" in properties else np.ones((1, 1))
    matrix = above if inherits.all() else np.eye(4)
    if ".ops" not in properties or ".vals" not in properties:
        return matrix
    values = properties.first(".vals").astype(np.float64).ravel()
    for operation in properties.first(".ops").ravel():
        count, as_matrix = _OPERATIONS[operation >> 4]  # the lower bits say what it is used for
        if len(values) < count:
            raise ValueError("a transform lacks numbers")
        matrix, values = matrix @ as_matrix(values[:count]), values[count:]
    return matrix


def _curves(properties: Compound, matrix: np.ndarray) -> Curves:
    kind, wrap, basis = LINEAR, OPEN, 0
    if "curveBasisAndType" in properties:
        kind, wrap, basis = properties.first("curveBasisAndType").ravel()[:3]
    if kind not in (_CUBIC, LINEAR) or wrap != OPEN:
        raise ValueError("its curves are closed, or of several orders")
    return Curves(
        points=properties.first("P").reshape(-1, 3),
        counts=properties.first("nVertices").ravel().astype(np.int64),
        basis=_BASES[basis] if kind == _CUBIC else "linear",
        widths=_widths(properties),
        matrix=matrix,
    )


def _widths(properties: Compound) -> np.ndarray | None:
    if "width" not in properties:
        return None
    if properties.is_compound("width"):
        indexed = properties.compound("width")
        return indexed.first(".vals").ravel()[indexed.first(".indices").ravel()]
    return properties.first("width").ravel()
