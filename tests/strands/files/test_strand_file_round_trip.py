"""What every format has to do alike."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
import torch
from any_strands import any_strands, assert_same_bits
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.strands.files import StrandFile, read_strands, write_strands

ENDINGS = (".hair", ".data", ".ply", ".npz")
one_folder_for_all = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
THREE = StrandFile(points=torch.arange(24.0).view(8, 3), counts=torch.tensor([3, 1, 4]))


@pytest.mark.parametrize("ending", ENDINGS)
@given(data=st.data())
@one_folder_for_all
def test_strands_come_back_to_the_bit(data: st.DataObject, ending: str, tmp_path: Path) -> None:
    strands = data.draw(any_strands(optional=()) if ending == ".data" else any_strands())
    write_strands(tmp_path / f"hair{ending}", strands)
    assert_same_bits(read_strands(tmp_path / f"hair{ending}"), strands)


@pytest.mark.parametrize("ending", ENDINGS)
def test_strands_of_equal_length_are_written_as_a_tensor(ending: str, tmp_path: Path) -> None:
    strands = torch.randn(4, 6, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    write_strands(tmp_path / f"hair{ending}", strands)
    found = read_strands(str(tmp_path / f"hair{ending}"))
    assert found.counts.tolist() == [6] * 4
    torch.testing.assert_close(found.points.view(4, 6, 3), strands.float(), atol=0, rtol=0)


@pytest.mark.parametrize("ending", ENDINGS)
@given(data=st.data())
@one_folder_for_all
def test_no_cut_file_is_read(data: st.DataObject, ending: str, tmp_path: Path) -> None:
    write_strands(tmp_path / f"whole{ending}", data.draw(any_strands()))
    content = (tmp_path / f"whole{ending}").read_bytes()
    cut = tmp_path / f"cut{ending}"
    cut.write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
    with pytest.raises(DynhairError, match="cut"):
        read_strands(cut)


@pytest.mark.parametrize("ending", ENDINGS)
@given(data=st.data())
@one_folder_for_all
def test_damaged_files_are_read_or_refused_but_never_crash(data: st.DataObject, ending: str, tmp_path: Path) -> None:
    write_strands(tmp_path / f"whole{ending}", data.draw(any_strands()))
    content = bytearray((tmp_path / f"whole{ending}").read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        # most of the places are among the counts at the front
        place = data.draw(st.integers(0, min(len(content), data.draw(st.sampled_from([24, 200, 10_000]))) - 1))
        content[place] = data.draw(st.integers(0, 255))
    damaged = tmp_path / f"damaged{ending}"
    damaged.write_bytes(content)
    with contextlib.suppress(DynhairError):
        read_strands(damaged).check(damaged)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("content", [b"", b"\0" * 200, b"HAIR", b"ply\nend_header\n", b"PK\3\4", b"\xff" * 4096])
def test_other_contents_are_refused(content: bytes, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"other{ending}"
    path.write_bytes(content)
    with pytest.raises(DynhairError, match="other"):
        read_strands(path)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_missing_file_is_said_to_be_missing(ending: str, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="No such file"):
        read_strands(tmp_path / f"nowhere{ending}")


@pytest.mark.parametrize("ending", [".data", ".hair", ".ply"])
def test_a_file_that_goes_on_is_refused(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"long{ending}"
    write_strands(path, THREE)
    path.write_bytes(path.read_bytes() + b"\0\0")
    with pytest.raises(DynhairError, match="goes on for 2 bytes"):
        read_strands(path)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e39])
def test_numbers_that_are_not_finite_are_neither_written_nor_read(bad: float, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"broken{ending}"
    strands = torch.zeros(2, 3, 3, dtype=torch.float64)
    strands[1, 1, 1] = bad
    with pytest.raises(DynhairError, match="1 of the 18 numbers of its points are NaN or infinite"):
        write_strands(path, strands)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "strands",
    [
        StrandFile(points=torch.zeros(0, 3), counts=torch.zeros(0, dtype=torch.int64)),
        StrandFile(points=torch.zeros(4, 3), counts=torch.tensor([2, 3])),
        StrandFile(points=torch.zeros(4, 3), counts=torch.tensor([4, 0])),
        StrandFile(points=torch.zeros(4, 3), counts=torch.tensor([5, -1])),
        StrandFile(points=torch.zeros(4, 3), counts=torch.tensor([2**62, 2**62, 2**62, 2**62, 4])),
    ],
)
@pytest.mark.parametrize("ending", ENDINGS)
def test_counts_that_do_not_add_up_are_not_written(strands: StrandFile, ending: str, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match=r"no strands in it|are not its 4 points"):
        write_strands(tmp_path / f"wrong{ending}", strands)
    assert list(tmp_path.iterdir()) == []


def test_unknown_endings_are_refused_with_those_that_are_known(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match=r"read as .obj\nexpected: .hair, .data, .ply, .npz"):
        read_strands(tmp_path / "hair.obj")
    with pytest.raises(DynhairError, match=r"written as .obj\nexpected: .hair, .data, .ply, .npz"):
        write_strands(tmp_path / "hair.obj", THREE)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_failed_write_leaves_the_old_file(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"hair{ending}"
    write_strands(path, THREE)
    old = path.read_bytes()
    with pytest.raises(DynhairError):
        write_strands(path, torch.full((1, 2, 3), float("nan")))
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]
