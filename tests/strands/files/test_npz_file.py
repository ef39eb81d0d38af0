"""``.npz`` files of ours and of others."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.strands.files import StrandFile, read_strands, write_strands

POINTS, COUNTS = np.arange(15.0).reshape(5, 3), np.array([3, 2])


def test_numpy_reads_what_is_written(tmp_path: Path) -> None:
    strands = StrandFile(points=torch.arange(9.0).view(3, 3), counts=torch.tensor([1, 2]), widths=torch.ones(3))
    write_strands(tmp_path / "ours.npz", strands)
    with np.load(tmp_path / "ours.npz") as arrays:
        assert sorted(arrays) == ["counts", "points", "widths"]
        np.testing.assert_array_equal(arrays["points"], strands.points)
        np.testing.assert_array_equal(arrays["counts"], [1, 2])


@pytest.mark.parametrize("dtype", ["<f2", "<f4", ">f8"])
@pytest.mark.parametrize("arranged", [np.ascontiguousarray, np.asfortranarray])
def test_one_array_of_strands(dtype: str, arranged: Callable[[np.ndarray], np.ndarray], tmp_path: Path) -> None:
    strands = np.arange(24.0).reshape(2, 4, 3)
    np.savez(tmp_path / "theirs.npz", strands=arranged(strands.astype(dtype)), other=np.arange(3))
    found = read_strands(tmp_path / "theirs.npz")
    assert found.counts.tolist() == [4, 4]
    np.testing.assert_array_equal(found.points, strands.reshape(-1, 3))


@pytest.mark.parametrize(
    ("found", "arrays"),
    [
        ("its arrays are roots", {"roots": POINTS}),
        ("`points` is float64 of shape .5, 2.", {"points": POINTS[:, :2], "counts": COUNTS}),
        ("`points` is int64", {"points": POINTS.astype(np.int64), "counts": COUNTS}),
        ("`counts` is float64", {"points": POINTS, "counts": COUNTS / 1}),
        ("`counts` is int64 of shape .1, 2.", {"points": POINTS, "counts": COUNTS[None]}),
        ("`widths` is float64 of shape .4,.", {"points": POINTS, "counts": COUNTS, "widths": np.ones(4)}),
        ("`colours` is float64 of shape .5, 4.", {"points": POINTS, "counts": COUNTS, "colours": np.ones((5, 4))}),
        ("2 strands of -2 to 7 points", {"points": POINTS, "counts": np.array([7, -2])}),
        ("1 of the 5 numbers of its widths", {"points": POINTS, "counts": COUNTS, "widths": [1, 2, np.inf, 4, 5.0]}),
        ("2 strands of 0 to 0 points", {"strands": np.zeros((2, 0, 3))}),
        ("`strands` is float64 of shape .5, 3.", {"strands": POINTS}),
        ("cannot be read", {"strands": np.array([{}])}),
    ],
)
def test_other_arrays_are_refused(found: str, arrays: dict[str, np.ndarray], tmp_path: Path) -> None:
    np.savez(tmp_path / "wrong.npz", allow_pickle=True, **arrays)
    with pytest.raises(DynhairError, match=found):
        read_strands(tmp_path / "wrong.npz")


@pytest.mark.parametrize("shape", [(10**15, 3), (-1, -15), (5, 2)])
def test_an_announced_size_that_is_not_there_takes_no_memory(shape: tuple[int, ...], tmp_path: Path) -> None:
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(tmp_path / "liar.npz", "w") as archive:
        archive.writestr("points.npy", member.getvalue() + POINTS.tobytes())
    with pytest.raises(DynhairError, match=r"points.npy is announced|cannot be read"):
        read_strands(tmp_path / "liar.npz")
