"""Arrays out of a stranger's pickle, without running anything that the stranger wrote.

A pickle is a program: it may call whatever it names. Here it can name only the classes below, which keep what they are
given and do nothing else; arrays are built afterwards from plain numbers, never by NumPy's or SciPy's own unpickling,
which trusts sizes and offsets in the file.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynhair.errors import DynhairError

_NUMBERS = {f"{kind}{size}" for kind in "iu" for size in (1, 2, 4, 8)} | {"f2", "f4", "f8", "b1"}


def read_arrays(path: Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Entries of a pickled dictionary: NumPy arrays, SciPy's compressed columns (made dense), or chumpy's leaves.

    Pickles of Python 2 and 3, any protocol. Other entries may be there if they are made of the same things.

    Raises:
        DynhairError: the file is missing or no such pickle, it names anything else, or an entry is missing or no array.
    """
    try:
        with path.open("rb") as file:
            content = _Unpickler(file, path).load()
    except DynhairError:
        raise
    except Exception as error:  # a malformed pickle may raise anything
        raise DynhairError(
            f"this is no readable pickle: {error}", path=path, expected=f"a dictionary of {', '.join(names)}"
        ) from error
    if not isinstance(content, dict):
        raise DynhairError("the pickle holds no dictionary", path=path, expected=", ".join(names))
    missing = [name for name in names if name not in content]
    if missing:
        raise DynhairError(f"there are no entries {', '.join(missing)}", path=path, expected=", ".join(names))
    arrays = {}
    for name in names:
        try:
            arrays[name] = _array(content[name])
        except Exception as error:  # so may what stands in an array's place
            raise DynhairError(f"entry {name} is no array of numbers", path=path) from error
    return arrays


class _Kept:
    """Stands for an object of the pickle: keeps the arguments and the state, and runs nothing."""

    def __new__(cls, *arguments: Any) -> _Kept:
        kept = super().__new__(cls)
        kept.arguments, kept.state = arguments, None
        return kept

    arguments: tuple[Any, ...]
    state: Any

    def __init__(self, *arguments: Any) -> None: ...

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Array(_Kept):
    """numpy.ndarray, whichever function makes it."""


class _Buffer(_Kept):
    """A numpy.ndarray of pickle protocol 5, whose arguments are buffer, dtype, shape and order."""


class _DType(_Kept):
    """numpy.dtype."""


class _Columns(_Kept):
    """scipy.sparse.csc_matrix."""


class _Leaf(_Kept):
    """chumpy.Ch around one array."""


class _Bytes(_Kept):
    """Bytes that Python 3 writes as text for the sake of Python 2."""


class _Rebuilt(_Kept):
    """What ``copyreg._reconstructor`` makes: an object of its first argument's class."""

    def __new__(cls, kind: Any, *rest: Any) -> _Kept:
        if not (isinstance(kind, type) and issubclass(kind, _Kept)):
            raise TypeError("not one of the classes that may be named")
        return kind.__new__(kind)


_ALLOWED: dict[tuple[str, str], type] = {
    **{(builtins, "object"): _Kept for builtins in ("builtins", "__builtin__")},
    **{(builtins, "set"): set for builtins in ("builtins", "__builtin__")},
    **{(builtins, "bytes"): _Bytes for builtins in ("builtins", "__builtin__")},
    **{(registry, "_reconstructor"): _Rebuilt for registry in ("copyreg", "copy_reg")},
    ("_codecs", "encode"): _Bytes,
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _DType,
    **{(f"numpy.{core}.multiarray", "_reconstruct"): _Array for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): _Kept for core in ("core", "_core")},
    **{(f"numpy.{core}.numeric", "_frombuffer"): _Buffer for core in ("core", "_core")},
    **{(f"scipy.sparse.{module}", "csc_matrix"): _Columns for module in ("csc", "_csc")},
    ("chumpy.ch", "Ch"): _Leaf,
}


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: Any, path: Path) -> None:
        super().__init__(file, encoding="latin1")
        self._path = path

    def find_class(self, module_name: str, global_name: str, /) -> type:
        try:
            return _ALLOWED[module_name, global_name]
        except KeyError:
            raise DynhairError(
                f"the pickle names {module_name}.{global_name}; nothing was run",
                path=self._path,
                expected="NumPy arrays, SciPy's csc_matrix and chumpy's Ch alone",
                mend="get the file from its publisher, or convert it to .npz on a machine that you can lose",
            ) from None


def _array(value: Any) -> np.ndarray:
    if isinstance(value, _Leaf):
        return _array(value.state["x"])
    if isinstance(value, _Columns):
        return _dense(value.state)
    if isinstance(value, _Buffer):
        data, dtype, shape, order = value.arguments
        return _numbers(data, dtype, shape, order)
    if isinstance(value, _Array):
        _, shape, dtype, is_fortran, data = value.state
        return _numbers(data, dtype, shape, "F" if is_fortran else "C")
    raise TypeError(type(value).__name__)


def _numbers(data: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray:
    code = dtype.arguments[0]
    if code not in _NUMBERS:
        raise TypeError(code)
    byte_order = dtype.state[1] if dtype.state and dtype.state[1] in ("<", ">") else "="
    if isinstance(data, _Bytes):
        data = data.arguments[0] if data.arguments else b""
    raw = data.encode("latin1") if isinstance(data, str) else data
    if not isinstance(raw, bytes | bytearray):
        raise TypeError(type(raw).__name__)
    return np.frombuffer(raw, np.dtype(code).newbyteorder(byte_order)).reshape(
        shape, order="F" if order == "F" else "C"
    )


def _dense(state: dict[str, Any]) -> np.ndarray:
    rows, columns = (int(size) for size in state["_shape"])
    data, indices, starts = (_array(state[name]) for name in ("data", "indices", "indptr"))
    dense = np.zeros((rows, columns))
    dense[indices, np.repeat(np.arange(columns), np.diff(starts))] = data
    return dense
