"""Checked reading of ``.npy`` and ``.npz`` files, never unpickling."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from dynhair.errors import DynhairError

Shape = tuple[int | None, ...]
"""A shape; None stands for any length."""


def read_npy(path: Path, shape: Shape) -> np.ndarray:
    """Read one finite numeric array.

    Raises:
        DynhairError: the file is missing, damaged, pickled, of another shape, or holds NaN or infinity.
    """
    with _readable(path), path.open("rb") as file:
        array = np.load(file, allow_pickle=False)
        if not isinstance(array, np.ndarray):
            array.close()
            raise ValueError("an archive of arrays, not one array")
    return _checked(array, shape, path, "the array")


def read_npz(path: Path, shapes: Mapping[str, Shape]) -> dict[str, np.ndarray]:
    """Read the arrays named in ``shapes`` from an archive.

    Raises:
        DynhairError: as for `read_npy`, or an array is not in the archive.
    """
    arrays: dict[str, np.ndarray] = {}
    with _readable(path), path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        if isinstance(archive, np.ndarray):
            raise ValueError("one array, not an archive of arrays")
        with archive:
            for name in shapes:
                if name not in archive.files:
                    raise DynhairError(
                        f"has no array `{name}`",
                        path=path,
                        expected=", ".join(shapes),
                        mend="write the file with np.savez and these names",
                    )
                arrays[name] = archive[name]
    return {name: _checked(arrays[name], shape, path, f"`{name}`") for name, shape in shapes.items()}


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise DynhairError(
            "the file is missing", path=path, expected="a file of NumPy's", mend="write it, or leave its frame out"
        ) from None
    except DynhairError:
        raise
    except Exception as error:  # damaged files make NumPy and zipfile raise all sorts
        pickled = "allow_pickle" in str(error)
        found = (
            "holds pickled objects, which are not opened"
            if pickled
            else f"cannot be read ({str(error) or type(error).__name__})"
        )
        raise DynhairError(
            found,
            path=path,
            expected="plain numeric arrays in NumPy's format",
            mend="write it again with np.save or np.savez from numeric arrays",
        ) from None


def _checked(array: np.ndarray, shape: Shape, path: Path, what: str) -> np.ndarray:
    if array.dtype.kind not in "fiu":
        raise DynhairError(f"{what} is of type {array.dtype}", path=path, expected="numbers")
    fits = array.ndim == len(shape) and all(
        wanted in (None, length) for wanted, length in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise DynhairError(f"{what} has the shape {array.shape}", path=path, expected=wanted)
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        bad = int((~np.isfinite(array)).sum())
        raise DynhairError(
            f"{what} holds {bad} of {array.size} values that are NaN or infinite",
            path=path,
            expected="finite numbers",
            mend="track this frame again, or leave it out of its segment",
        )
    return array
