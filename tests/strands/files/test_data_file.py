"""``.data`` files built byte by byte."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.strands.files import StrandFile, read_strands, write_strands

TWO = struct.pack("<ii6fi3f", 2, 2, *range(6), 1, 6, 7, 8)


def test_the_layout_of_the_data_set(tmp_path: Path) -> None:
    path = tmp_path / "hand.data"
    path.write_bytes(TWO)
    found = read_strands(path)
    assert found.counts.tolist() == [2, 1]
    assert found.points.flatten().tolist() == list(range(9))
    write_strands(tmp_path / "ours.data", found)
    assert (tmp_path / "ours.data").read_bytes() == TWO


def test_widths_and_colours_are_left_out(tmp_path: Path) -> None:
    strands = StrandFile(points=torch.zeros(2, 3), counts=torch.tensor([2]), widths=torch.ones(2))
    write_strands(tmp_path / "hair.data", strands)
    assert read_strands(tmp_path / "hair.data").widths is None


@pytest.mark.parametrize(
    ("found", "content"),
    [
        ("announces -1 strands", struct.pack("<i", -1) + bytes(32)),
        ("announces 2147483647 strands", struct.pack("<i", 2**31 - 1) + bytes(32)),
        ("ends too early", struct.pack("<ii", 1, 2**31 - 1) + bytes(32)),
        ("announces -5 numbers", struct.pack("<ii", 1, -5) + bytes(32)),
        ("announces 1 strands in 8 bytes", struct.pack("<ii", 1, 0)),
        ("2 strands of 0 to 3 points", struct.pack("<iii9f", 2, 0, 3, *range(9))),
        ("announces 0 strands in 4 bytes", struct.pack("<i", 0)),
        ("1 of the 9 numbers of its points", TWO[:-4] + struct.pack("<f", float("nan"))),
    ],
)
def test_impossible_counts_are_refused(found: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "wrong.data"
    path.write_bytes(content)
    with pytest.raises(DynhairError, match=found):
        read_strands(path)
