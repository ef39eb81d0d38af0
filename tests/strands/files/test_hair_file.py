"""``.hair`` files built byte by byte from the format's published description."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.strands.files import StrandFile, read_strands, write_strands


def header(strands: int, points: int, arrays: int, segments: int = 0, *defaults: float) -> bytes:
    return struct.pack("<4s4I5f88s", b"HAIR", strands, points, arrays, segments, *(defaults or (1, 0, 1, 1, 1)), b"x")


def written(folder: Path, *parts: bytes) -> Path:
    path = folder / "hand.hair"
    path.write_bytes(b"".join(parts))
    return path


def test_all_arrays(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        header(2, 5, 0b11111),
        struct.pack("<2H", 2, 1),
        struct.pack("<15f", *range(15)),
        struct.pack("<5f", *range(20, 25)),
        struct.pack("<5f", *range(30, 35)),
        struct.pack("<15f", *range(40, 55)),
    )
    found = read_strands(path)
    assert found.counts.tolist() == [3, 2]
    assert found.points.flatten().tolist() == list(range(15))
    assert found.widths is not None
    assert found.widths.tolist() == list(range(20, 25))
    assert found.transparencies is not None
    assert found.transparencies.tolist() == list(range(30, 35))
    assert found.colours is not None
    assert found.colours.flatten().tolist() == list(range(40, 55))


def test_points_alone_have_the_default_segments_and_what_is_said_of_all(tmp_path: Path) -> None:
    points = struct.pack("<12f", *range(12))
    found = read_strands(written(tmp_path, header(2, 4, 0b10, 1, 0.5, 0.25, 0.1, 0.2, 0.3), points))
    assert found.counts.tolist() == [2, 2]
    torch.testing.assert_close(found.widths, torch.full((4,), 0.5))
    torch.testing.assert_close(found.transparencies, torch.full((4,), 0.25))
    torch.testing.assert_close(found.colours, torch.tensor([[0.1, 0.2, 0.3]]).expand(4, 3))


def test_the_values_of_the_formats_library_say_nothing(tmp_path: Path) -> None:
    found = read_strands(written(tmp_path, header(1, 2, 0b10, 1), struct.pack("<6f", *range(6))))
    assert found.widths is None
    assert found.transparencies is None
    assert found.colours is None


def test_what_is_written_is_the_published_format(tmp_path: Path) -> None:
    strands = StrandFile(
        points=torch.arange(15.0).view(5, 3), counts=torch.tensor([3, 2]), transparencies=torch.arange(5.0)
    )
    write_strands(tmp_path / "ours.hair", strands)
    content = (tmp_path / "ours.hair").read_bytes()
    assert struct.unpack("<4s4I5f", content[:40]) == (b"HAIR", 2, 5, 0b01011, 0, 1, 0, 1, 1, 1)
    assert content[128:] == struct.pack("<2H15f5f", 2, 1, *range(15), *range(5))


@pytest.mark.parametrize(
    ("found", "parts"),
    [
        ("has no points", (header(1, 2, 0b1), struct.pack("<H", 1))),
        ("2 strands of 1 segments are not its 5 points", (header(2, 5, 0b10, 1), bytes(60))),
        ("2 strands of 2 to 3 points are not its 6 points", (header(2, 6, 0b11), struct.pack("<2H", 2, 1), bytes(72))),
        ("ends too early", (header(1, 2**32 - 1, 0b10, 2**32 - 2), bytes(60))),
        ("ends too early", (header(2**32 - 1, 5, 0b11), bytes(60))),
        ("starts with", (b"hair", bytes(200))),
    ],
)
def test_headers_that_contradict_the_file_are_refused(found: str, parts: tuple[bytes, ...], tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match=found):
        read_strands(written(tmp_path, *parts))


def test_segments_are_counted_as_far_as_16_bits_go(tmp_path: Path) -> None:
    most = 65_536
    strands = StrandFile(points=torch.zeros(most + 2, 3), counts=torch.tensor([most, 2]))
    write_strands(tmp_path / "long.hair", strands)
    assert read_strands(tmp_path / "long.hair").counts.tolist() == [most, 2]
    strands = StrandFile(points=torch.zeros(most + 3, 3), counts=torch.tensor([most + 1, 2]))
    with pytest.raises(DynhairError, match=r"a strand has 65537 points\nexpected: at most 65,536"):
        write_strands(tmp_path / "longer.hair", strands)
    write_strands(tmp_path / "alike.hair", torch.zeros(2, most + 1, 3))
    assert read_strands(tmp_path / "alike.hair").counts.tolist() == [most + 1] * 2
