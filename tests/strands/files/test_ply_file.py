"""``.ply`` files written by hand and as other programs write them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.strands.files import StrandFile, read_strands, write_strands

ASCII = """ply
format ascii 1.0
comment made by hand
element vertex 5
property float x
property double y
property float z
property uchar red
property uchar green
property uchar blue
element face 0
property list uchar int vertex_indices
element edge 3
property int vertex1
property int vertex2
end_header
0 1 2 255 0 51
3 4 5 0 0 0
6.5 -7 8e-3 0 0 0
9 10 11 0 0 0
12 13 14 0 0 0
0 1
2 1
3 4
"""


def curls(strands: int, points: int, seed: int = 0) -> np.ndarray:
    """Strands from scattered roots."""
    random = np.random.default_rng(seed)
    steps = random.normal([0, -1, 0], 0.3, (strands, points, 3)) * 0.2 / points
    return (random.normal(0, 0.08, (strands, 1, 3)) + steps.cumsum(1)).astype(np.float32)


def plain(folder: Path, points: np.ndarray, *comments: str, order: str = "<") -> Path:
    """Points alone, with colours of no meaning, as trimesh writes point clouds."""
    path = folder / "plain.ply"
    rows = np.zeros(
        len(points), [(name, f"{order}f4") for name in "xyz"] + [(n, "u1") for n in ("red", "green", "blue", "alpha")]
    )
    for axis, name in enumerate("xyz"):
        rows[name] = points[:, axis]
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    header = ["ply", f"format {form} 1.0", *comments, f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in "xyz"]
    header += [f"property uchar {name}" for name in ("red", "green", "blue", "alpha")]
    path.write_bytes("\n".join([*header, "end_header\n"]).encode() + rows.tobytes())
    return path


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_ascii_with_byte_colours_and_edges_in_either_direction(line_end: str, tmp_path: Path) -> None:
    path = tmp_path / "hand.ply"
    path.write_bytes(ASCII.replace("\n", line_end).encode())
    found = read_strands(path)
    assert found.counts.tolist() == [3, 2]
    torch.testing.assert_close(found.points[2], torch.tensor([6.5, -7, 8e-3]))
    assert found.colours is not None
    torch.testing.assert_close(found.colours[0], torch.tensor([1, 0, 0.2]))
    assert found.widths is None


def test_what_is_written_is_plain_ply(tmp_path: Path) -> None:
    strands = StrandFile(points=torch.arange(9.0).view(3, 3), counts=torch.tensor([1, 2]), widths=torch.ones(3))
    write_strands(tmp_path / "ours.ply", strands)
    header, body = (tmp_path / "ours.ply").read_bytes().split(b"end_header\n")
    declared = [line for line in header.decode().splitlines() if line.split()[0] in ("element", "property")]
    assert declared == [
        "element vertex 3",
        *(f"property float {name}" for name in ("x", "y", "z", "width")),
        "element edge 1",
        "property int vertex1",
        "property int vertex2",
    ]
    assert body == struct.pack("<12f2i", 0, 1, 2, 1, 3, 4, 5, 1, 6, 7, 8, 1, 1, 2)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("length", [100, 200])
@pytest.mark.parametrize("strands", [1, 2, 30])
def test_plain_points_are_told_apart_where_they_jump(strands: int, length: int, order: str, tmp_path: Path) -> None:
    points = curls(strands, length).reshape(-1, 3)
    found = read_strands(plain(tmp_path, points, order=order))
    assert found.counts.tolist() == [length] * strands
    assert found.points.numpy().tobytes() == points.tobytes()


def test_a_comment_tells_the_strands_length(tmp_path: Path) -> None:
    points = curls(4, 25).reshape(-1, 3)
    assert read_strands(plain(tmp_path, points, "comment points_per_strand 25")).counts.tolist() == [25] * 4
    with pytest.raises(DynhairError, match="100 points are not strands of 30"):
        read_strands(plain(tmp_path, points, "comment points_per_strand 30"))


@pytest.mark.parametrize(
    "points",
    [
        curls(3, 70).reshape(-1, 3),  # no multiple of either length
        curls(40, 50).reshape(-1, 3),  # jumps at every hundred, but as much in their middle
        np.random.default_rng(0).normal(size=(400, 3)),  # jumps everywhere
        np.cumsum(np.full((600, 3), 0.01), 0),  # jumps nowhere
        np.concatenate([curls(6, 200).reshape(-1, 3), curls(12, 100).reshape(-1, 3)]),  # both lengths
    ],
)
def test_plain_points_that_do_not_tell_are_refused(points: np.ndarray, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match=r"do not tell where strands end(.|\n)*comment points_per_strand 100"):
        read_strands(plain(tmp_path, points))


@pytest.mark.parametrize(
    ("found", "old", "new"),
    [
        ("do not join each point to the next", "\n2 1\n", "\n2 0\n"),
        ("do not join each point to the next", "\n3 4\n", "\n4 5\n"),
        ("do not join each point to the next", "\n0 1\n", "\n-1 0\n"),
        ("holds 1 of face, which are lists: a mesh", "face 0", "face 1"),
        ("ends too early", "vertex 5", "vertex 6"),
        ("ends too early", "vertex 5", "vertex 999999999999999999"),
        ("announces -5 numbers", "vertex 5", "vertex -5"),
        ("malformed", "vertex 5", "vertex many"),
        ("malformed", "format ascii 1.0\n", ""),
        ("malformed", "ascii", "morse"),
        ("malformed", "double", "quadruple"),
        ("malformed", "double y", "double x"),
        ("malformed", "double y", "double why"),
        ("malformed", "vertex 5", "point 5"),
        ("malformed", "\n9 10", "\nnine 10"),
        ("malformed", "\n3 4\n", "\nnan 4\n"),
        ("malformed", "int vertex1", "float vertex1"),
        ("malformed", "int vertex1", "int first"),
        ("malformed", "end_header", "header_end"),
        ("1 of the 15 numbers of its points", "6.5", "inf"),
        ("1 of the 15 numbers of its points", "\n6.5 -7", "\n6.5 -7e300"),
    ],
)
def test_malformed_files_are_refused(found: str, old: str, new: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.ply"
    assert old in ASCII
    path.write_text(ASCII.replace(old, new))
    with pytest.raises(DynhairError, match=found):
        read_strands(path)
