"""Avatars on disk, exported in every format that needs no other program."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from dynhair.animation import driving_track, read_motion
from dynhair.avatar import Avatar, HeadMesh
from dynhair.errors import DynhairError
from dynhair.export.run import chosen_frames, run_export
from dynhair.export.splats import Splats
from dynhair.strands.files import read_strands
from splat_files import read_splats
from tiny_avatars import make_avatar


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_avatar().save(tmp_path / "avatar")
    return tmp_path / "avatar"


def quiet() -> Console:
    return Console(file=StringIO())


def test_every_format_holds_the_driven_avatar(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    formats = ["ply", "compressed", "usd", "abc", "hair", "data", "npz", "polylines", "motion"]
    written = run_export(folder, out, formats, motion="nod", frames="2:5", console=quiet())
    assert [path.name for path in written] == [
        *("ply", "compressed", "avatar.usdc", "avatar.abc", "hair", "data", "npz", "polylines", "motion.npz")
    ]
    assert {path.name for path in out.iterdir()} == {path.name for path in written}
    avatar = Avatar.load(folder)
    assert avatar.recording is not None
    track = driving_track("nod", avatar.recording, avatar)
    for frame in (2, 3, 4):
        with torch.no_grad():
            posed = avatar.pose(track, frame)
        splats = read_splats(out / "ply" / f"{frame:04d}.ply")
        torch.testing.assert_close(splats.means, Splats.of(avatar, posed).means)
        for path in (f"hair/{frame:04d}.hair", f"data/{frame:04d}.data", f"npz/{frame:04d}.npz"):
            points = read_strands(out / path).points
            torch.testing.assert_close(points, posed.strands.reshape(-1, 3))
        polylines = read_strands(out / "polylines" / f"{frame:04d}.ply")
        torch.testing.assert_close(polylines.points, posed.strands.reshape(-1, 3))
    for first in ("avatar.usdc", "avatar.abc"):
        found, hundredth = read_strands(out / first).points, 0.01 if first.endswith("abc") else 1
        with torch.no_grad():
            expected = avatar.pose(track, 2).strands.reshape(-1, 3)
        torch.testing.assert_close(found * hundredth, expected, atol=1e-5, rtol=0)
    assert len(list((out / "compressed").iterdir())) == 3
    motion = read_motion(out / "motion.npz")
    np.testing.assert_allclose(motion.rotations, track.rotations[2:5], atol=1e-6)


def test_without_a_motion_the_avatar_rests(folder: Path, tmp_path: Path) -> None:
    run_export(folder, tmp_path / "out", ["hair"], console=quiet())
    avatar = Avatar.load(folder)
    assert avatar.recording is not None
    with torch.no_grad():
        posed = avatar.live(1.0, 0).step(avatar.recording.rest.rotation, avatar.recording.rest.translation)
    assert posed is not None
    (path,) = (tmp_path / "out" / "hair").iterdir()
    torch.testing.assert_close(read_strands(path).points, posed.strands.reshape(-1, 3))


def test_a_shorter_sequence_leaves_nothing_of_a_longer_one(folder: Path, tmp_path: Path) -> None:
    for frames in ("0:4", "1:3"):
        run_export(folder, tmp_path, ["npz"], motion="turn", frames=frames, rigid_hair=True, console=quiet())
    assert sorted(path.name for path in (tmp_path / "npz").iterdir()) == ["0001.npz", "0002.npz"]


def test_what_super_resolution_would_add_is_said_to_be_lost(tmp_path: Path) -> None:
    make_avatar(super_resolution=2).save(tmp_path / "avatar")
    console = quiet()
    run_export(tmp_path / "avatar", tmp_path / "out", ["ply"], console=console)
    assert isinstance(console.file, StringIO)
    assert "before super-resolution" in console.file.getvalue()


@pytest.mark.parametrize("formats", [["obj"], [], ["ply", "gltf"]])
def test_unknown_formats_are_named_before_anything_is_written(folder: Path, tmp_path: Path, formats: list[str]) -> None:
    with pytest.raises(DynhairError, match="format") as caught:
        run_export(folder, tmp_path / "out", formats, console=quiet())
    assert caught.value.expected is not None
    assert "polylines" in caught.value.expected
    assert not (tmp_path / "out").exists()


def test_a_head_mesh_that_nobody_has_is_an_error_only_where_it_is_all(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="capture is not known"):
        run_export(folder, tmp_path / "out", ["head"], console=quiet())
    console = quiet()
    run_export(folder, tmp_path / "out", ["abc"], console=console)
    assert isinstance(console.file, StringIO)
    assert "without a head mesh" in console.file.getvalue()


def test_the_head_mesh_that_an_avatar_keeps_needs_no_capture(tmp_path: Path) -> None:
    avatar = make_avatar()
    avatar.head_mesh = HeadMesh(0.1 * torch.rand(6, 3), torch.tensor([[0, 1, 2], [3, 4, 5]]))
    avatar.save(tmp_path / "avatar")
    run_export(tmp_path / "avatar", tmp_path / "out", ["head"], motion="nod", frames="0:2", console=quiet())
    first, second = sorted((tmp_path / "out" / "head").iterdir())
    lines = first.read_text().splitlines()
    assert [line for line in lines if line.startswith("f ")] == ["f 1 2 3", "f 4 5 6"]
    assert sum(line.startswith("v ") for line in lines) == 6
    assert second.suffix == ".obj"


def test_a_motion_that_nobody_knows_is_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="`nodd`"):
        run_export(folder, tmp_path / "out", motion="nodd", console=quiet())


def test_frames_are_chosen() -> None:
    assert chosen_frames(None, 5) == range(5)
    assert chosen_frames("1:3", 5) == range(1, 3)
    assert chosen_frames("3:", 5) == range(3, 5)
    assert chosen_frames(":2", 5) == range(2)
    for wrong in ("3", "3:2", "2:6", "a:b", "-1:3", "1:2:3", "0:0"):
        with pytest.raises(DynhairError):
            chosen_frames(wrong, 5)
