"""``.npz`` files of strands: NumPy's arrays by name.

Ours hold ``points`` (P, 3) and ``counts`` (N,) and, where they are known, ``widths`` (P,), ``transparencies`` (P,) and
``colours`` (P, 3). Read as well: one array ``strands`` (N, L, 3).
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError
from dynhair.storage import atomic_file
from dynhair.strands.files.strand_file import StrandFile

_EXPECTED = "floating-point `points` (P, 3) and whole `counts` (N,), or floating-point `strands` (N, L, 3)"
_OPTIONAL = {"widths": (), "transparencies": (), "colours": (3,)}


def read_npz(path: Path) -> StrandFile:
    """Read a ``.npz`` file.

    Raises:
        DynhairError: it cannot be read, or has not these arrays.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            arrays = {info.filename.removesuffix(".npy"): _array(archive, info) for info in archive.infolist()}
    except Exception as error:  # damaged archives make zipfile and NumPy raise all sorts
        raise DynhairError(
            f"it cannot be read ({str(error) or type(error).__name__})", path=path, expected=_EXPECTED
        ) from None
    if "strands" in arrays:
        strands = _checked(arrays, "strands", (None, None, 3), path)
        return StrandFile.from_arrays(path, strands.reshape(-1, 3), np.full(len(strands), strands.shape[1]))
    if not {"points", "counts"} <= arrays.keys():
        raise DynhairError(f"its arrays are {', '.join(sorted(arrays)) or 'none'}", path=path, expected=_EXPECTED)
    points, counts = _checked(arrays, "points", (None, 3), path), _checked(arrays, "counts", (None,), path, kinds="iu")
    given = {
        name: _checked(arrays, name, (len(points), *each), path) for name, each in _OPTIONAL.items() if name in arrays
    }
    return StrandFile.from_arrays(path, points, counts, **given)


def write_npz(path: Path, strands: StrandFile) -> None:
    """Write a ``.npz`` file, compressed."""
    given = {name: getattr(strands, name) for name in ("points", "counts", *_OPTIONAL)}
    arrays = {name: values.numpy() for name, values in given.items() if values is not None}
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """One array, whose announced size must be what is there before memory is taken for it."""
    with archive.open(info) as member:
        version = np.lib.format.read_magic(member)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, is_fortran, dtype = read_header(member)
        count = 1
        for length in shape:
            count *= length
        if dtype.hasobject or count * dtype.itemsize != info.file_size - member.tell():
            raise ValueError(f"{info.filename} is announced as {dtype} of shape {shape}, which it is not")
        return np.frombuffer(member.read(), dtype).reshape(shape, order="F" if is_fortran else "C")


def _checked(
    arrays: Mapping[str, np.ndarray], name: str, shape: tuple[int | None, ...], path: Path, kinds: str = "f"
) -> np.ndarray:
    array = arrays[name]
    fits = array.ndim == len(shape) and all(
        wanted in (None, length) for wanted, length in zip(shape, array.shape, strict=True)
    )
    if not fits or array.dtype.kind not in kinds:
        raise DynhairError(f"`{name}` is {array.dtype} of shape {array.shape}", path=path, expected=_EXPECTED)
    return array
