"""Pickles of strangers: arrays come out, nothing of theirs runs."""

from __future__ import annotations

import collections
import os
import pickle
import struct
import sys
import types
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csc_matrix

from dynhair.errors import DynhairError
from dynhair.face.array_pickle import read_arrays


class Ch:
    """chumpy's leaf, as far as its pickle shows it."""

    __module__ = "chumpy.ch"

    def __init__(self, x: np.ndarray) -> None:
        self.x, self._dirty_vars, self._itr, self._depends_on_deps = x, {"x"}, None, {}


@pytest.fixture
def chumpy(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("chumpy.ch")
    module.Ch = Ch  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "chumpy", types.ModuleType("chumpy"))
    monkeypatch.setitem(sys.modules, "chumpy.ch", module)


@pytest.mark.usefixtures("chumpy")
@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_of_every_kind_come_out(tmp_path: Path, protocol: int) -> None:
    generator = np.random.default_rng(0)
    dense = generator.normal(size=(4, 6)) * (generator.random((4, 6)) < 0.5)
    written = {
        "plain": generator.normal(size=(3, 4, 2)),
        "fortran": np.asfortranarray(generator.normal(size=(3, 5))),
        "big": np.arange(5, dtype=">i4"),
        "faces": np.arange(6, dtype=np.uint32).reshape(2, 3),
        "single": np.array(2.5, dtype=np.float32),
        "empty": np.zeros((0, 3)),
        "sparse": csc_matrix(dense),
        "leaf": Ch(generator.normal(size=(2, 3))),
        "words": "lbs",
        "number": np.float64(3.0),
    }
    path = tmp_path / "model.pkl"
    path.write_bytes(pickle.dumps(written, protocol=protocol))
    names = [name for name in written if name not in ("words", "number")]
    found = read_arrays(path, names)
    for name in names:
        truth = {"sparse": dense, "leaf": written["leaf"].x}.get(name, written[name])
        np.testing.assert_array_equal(found[name], truth)
        assert found[name].dtype == truth.dtype


def test_a_pickle_of_python_2_is_read(tmp_path: Path) -> None:
    """Written out by hand: protocol 2, byte strings, and the module names of Python 2."""
    data = np.array([1.5, -2.0, 3e300])
    raw = data.tobytes()
    pickled = (
        b"\x80\x02}U\x01xcnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R"
        b"(K\x01K\x03\x85cnumpy\ndtype\nU\x02f8K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
        b"\x89T" + struct.pack("<i", len(raw)) + raw + b"tbs"
        b"U\x04leafccopy_reg\n_reconstructor\ncchumpy.ch\nCh\nc__builtin__\nobject\nN\x87R}U\x01xK\x07sbs."
    )
    path = tmp_path / "model.pkl"
    path.write_bytes(pickled)
    np.testing.assert_array_equal(read_arrays(path, ["x"])["x"], data)


class Calls:
    """Calls a function when it is unpickled."""

    def __init__(self, function: Callable[..., object], *arguments: object) -> None:
        self.call = function, arguments

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return self.call


def exploits(mark: Path) -> dict[str, bytes]:
    """Pickles that write a file when they are loaded as usual."""
    command = f"touch {mark}"
    code = f"open({str(mark)!r}, 'w')"
    named = {
        "system": Calls(os.system, command),
        "eval": Calls(eval, code),
        "exec": Calls(exec, code),
        "getattr": Calls(getattr, "", "join"),
        "open": Calls(open, str(mark), "w"),
        "numpy's loader": Calls(np.load, str(mark)),
        "another dictionary": collections.Counter("a"),
    }
    pickled = {name: pickle.dumps({"x": value}) for name, value in named.items()}
    return pickled | {
        "protocol 0": b"cposix\nsystem\n(S'" + command.encode() + b"'\ntR.",
        "instance": b"(S'" + command.encode() + b"'\nios\nsystem\n.",
        "a method of what is allowed": b"\x80\x04\x8c\x05numpy\x8c\x0cndarray.dump\x93.",
        "a module's own name": b"\x80\x04\x8c\x05numpy\x8c\x08f2py.run\x93.",
        "numpy's unsafe dtype": pickle.dumps({"x": np.array([print], dtype=object)}),
    }


@pytest.mark.parametrize("name", exploits(Path("x")))
def test_nothing_else_may_be_named(tmp_path: Path, name: str) -> None:
    mark, path = tmp_path / "mark", tmp_path / "model.pkl"
    path.write_bytes(exploits(mark)[name])
    with pytest.raises(DynhairError, match=r"names \S+; nothing was run") as caught:
        read_arrays(path, ["x"])
    assert caught.value.path == path
    assert not mark.exists()


def test_the_exploits_are_ones(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    pickle.loads(exploits(mark)["system"])
    assert mark.exists()


@pytest.mark.parametrize(
    "pickled",
    [
        b"",
        b"\x80\x04.",
        b"cnumpy\nndarray\n}S'__setstate__'\nNsb.",  # sets the state of a class
        b"cnumpy\nndarray\nN}S'__setstate__'\nNs\x86b.",  # and its attributes
        b"c__builtin__\nset\nN}S'add'\nNs\x86b.",
        b"ccopy_reg\n_reconstructor\n(c__builtin__\nset\nc__builtin__\nobject\nNtR.",
        b"\x82\x01.",  # an extension's code
        b"S'me'\nQ.",  # a persistent object
        pickle.dumps([1, 2]),
        pickle.dumps({"y": 1}),
    ],
)
def test_other_pickles_are_refused(tmp_path: Path, pickled: bytes) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(pickled)
    with pytest.raises(DynhairError):
        read_arrays(path, ["x"])
    with pytest.raises(DynhairError):
        read_arrays(tmp_path / "none.pkl", ["x"])


def reconstructed(shape: bytes, dtype: bytes, data: bytes) -> bytes:
    """A pickled array with a state of one's own."""
    head = b"(dS'x'\ncnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR"
    return head + b"(I1\n" + shape + b"cnumpy\ndtype\n(" + dtype + b"I0\nI1\ntRI00\n" + data + b"tbs."


def test_the_state_of_arrays_is_not_trusted(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    path.write_bytes(reconstructed(b"(I1\nt", b"S'f8'\n", b"S'12345678'\n"))
    assert read_arrays(path, ["x"])["x"].tobytes() == b"12345678"
    for pickled in (
        reconstructed(b"(I9\nt", b"S'f8'\n", b"S'12345678'\n"),  # more than there is
        reconstructed(b"(I1\nt", b"S'O8'\n", b"S'12345678'\n"),  # pointers
        reconstructed(b"(I1\nt", b"S'V8'\n", b"S'12345678'\n"),
        reconstructed(b"(I1\nt", b"S'f8'\n", b"I8\n"),
        reconstructed(b"(I1\nt", b"N", b"S'12345678'\n"),
        reconstructed(b"S'text'\n", b"S'f8'\n", b"S'12345678'\n"),
    ):
        path.write_bytes(pickled)
        with pytest.raises(DynhairError, match="no array of numbers"):
            read_arrays(path, ["x"])


def test_columns_that_point_outside_of_the_matrix_are_refused(tmp_path: Path) -> None:
    matrix = csc_matrix(np.eye(3))
    matrix.indices[1] = 1_000_000
    path = tmp_path / "model.pkl"
    path.write_bytes(pickle.dumps({"x": matrix}))
    with pytest.raises(DynhairError, match="no array of numbers"):
        read_arrays(path, ["x"])


@settings(max_examples=50)
@given(st.data())
def test_half_a_pickle_is_refused(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    whole = pickle.dumps({"x": np.arange(4.0)})
    path = tmp_path_factory.mktemp("half") / "model.pkl"
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
    with pytest.raises(DynhairError):
        read_arrays(path, ["x"])
