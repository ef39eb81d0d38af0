"""Alembic archives written by Blender and by Alembic's own library."""

from __future__ import annotations

import contextlib
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenes import DATA, blender_scene, control_points

from dynhair.errors import DynhairError
from dynhair.strands.files import StrandFile, read_strands, write_strands
from dynhair.strands.files.curves import on_curve

# For row vectors, from below each transform of operations.abc to above it.
OPERATIONS = np.array(
    [
        [0.689099132, 0.668536692, -0.279644556, 0],
        [-0.3473858, 1.054039069, 1.663828341, 0],
        [-2.110629873, 1.574097177, -1.437866342, 0],
        [1, 2, 3, 1],
    ]
)
MATRIX = np.array([[0, 2.0, 0, 0], [-2, 0, 0, 0], [0, 0, 2, 0], [7, 8, 9, 1]])


def strands_of(found: StrandFile, counts: list[int]) -> tuple[np.ndarray, list[float]]:
    """Points and widths of the object whose strands have these counts."""
    every = found.counts.tolist()
    first = next(i for i in range(len(every)) if every[i : i + len(counts)] == counts)
    rows = slice(sum(every[:first]), sum(every[: first + len(counts)]))
    assert found.widths is not None
    return found.points[rows].numpy(), found.widths[rows].tolist()


def test_blenders_curves_are_where_they_are_at_the_first_frame() -> None:
    found = read_strands(DATA / "blender.abc")
    assert len(found.counts) == 5
    for counts, points, widths in zip(*blender_scene(), strict=True):
        found_points, found_widths = strands_of(found, counts)
        np.testing.assert_allclose(found_points, points, atol=2e-6)
        assert found_widths == pytest.approx(list(widths))


def test_all_operations_of_transforms_and_all_bases() -> None:
    found = read_strands(DATA / "operations.abc")
    assert sorted(found.counts.tolist()) == [2, 3, 4, 5, 7]

    def placed(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        return points @ matrix[:3, :3] + matrix[3, :3]

    points, widths = strands_of(found, [2, 3])
    np.testing.assert_allclose(points, placed(control_points(0, 5), OPERATIONS), atol=1e-6)
    scale = 6 ** (1 / 3)
    assert widths == pytest.approx([0.25 * scale] * 2 + [0.5 * scale] * 3)

    points, widths = strands_of(found, [4, 7])
    bezier = on_curve(control_points(10, 11), np.array([4, 7]), "bezier")
    np.testing.assert_allclose(points, placed(bezier, MATRIX @ OPERATIONS), atol=1e-5)
    assert widths == pytest.approx([0.125 * 2 * scale] * 11)

    points, widths = strands_of(found, [5])
    spline = on_curve(control_points(30, 5), np.array([5]), "bspline")
    np.testing.assert_allclose(points, 3 * spline, atol=1e-6)
    assert widths == pytest.approx([1.5, 2.25, 1.5, 2.25, 2.25])


def test_archives_without_curves_and_of_the_old_kind_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="no curves in it"):
        read_strands(DATA / "mesh.abc")
    path = tmp_path / "old.abc"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(DynhairError, match=r"stored as HDF5(.|\n)*abcconvert -toOgawa"):
        read_strands(path)


@pytest.mark.parametrize(
    ("found", "place", "value"),
    [
        ("it starts with", 0, b"Agawa"),
        ("did not finish", 5, b"\0"),
        ("a group is announced", 8, struct.pack("<Q", 2**40)),
        ("a group is announced", 8, struct.pack("<Q", 2**64 - 1)),
        ("tuple index out of range", 8, bytes(8)),
    ],
)
def test_damaged_headers_are_refused(found: str, place: int, value: bytes, tmp_path: Path) -> None:
    content = bytearray((DATA / "blender.abc").read_bytes())
    content[place : place + len(value)] = value
    (tmp_path / "damaged.abc").write_bytes(content)
    with pytest.raises(DynhairError, match=f"it is damaged .*{found}"):
        read_strands(tmp_path / "damaged.abc")


def test_objects_that_lie_in_one_another_are_refused(tmp_path: Path) -> None:
    content = bytearray((DATA / "blender.abc").read_bytes())
    (root,) = struct.unpack_from("<Q", content, 8)
    (top,) = struct.unpack_from("<Q", content, root + 8 + 2 * 8)
    struct.pack_into("<Q", content, top + 8 + 8, top)
    (tmp_path / "loop.abc").write_bytes(content)
    with pytest.raises(DynhairError, match="two objects are at byte"):
        read_strands(tmp_path / "loop.abc")


@given(places=st.lists(st.tuples(st.integers(0, 5086), st.integers(0, 255)), max_size=6), length=st.integers(0, 5087))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
def test_damaged_archives_are_read_or_refused_but_never_crash(
    places: list[tuple[int, int]], length: int, tmp_path: Path
) -> None:
    content = bytearray((DATA / "operations.abc").read_bytes())
    for place, value in places:
        content[place] = value
    (tmp_path / "damaged.abc").write_bytes(content[:length] if not places else content)
    with contextlib.suppress(DynhairError):
        read_strands(tmp_path / "damaged.abc").check(tmp_path)


def test_archives_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match=r"cannot be written as \.abc"):
        write_strands(tmp_path / "hair.abc", read_strands(DATA / "blender.abc"))
