"""``dynhair edit``: edits of an avatar on disk."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from PIL import Image
from rich.console import Console

from dynhair.avatar import Avatar, Recording, head_pose
from dynhair.edit_options import EditOptions
from dynhair.editing import Brightness, Thin, Tint, Trim, Width
from dynhair.editing.run import run_edit
from dynhair.errors import DynhairError
from tiny_avatars import front_camera, head_track, make_avatar


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    avatar, track = make_avatar(), head_track()
    avatar.recording = Recording(track.fps, track.gravity, head_pose(track, 0), front_camera())
    avatar.save(tmp_path / "avatar")
    return tmp_path / "avatar"


def quiet() -> Console:
    return Console(file=io.StringIO(), width=200)


def printed(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_edits_are_appended_listed_and_pictured(folder: Path) -> None:
    tensors = (folder / "avatar.safetensors").read_bytes()
    run_edit(folder, EditOptions(brightness=0.7, trim=0.8, region="left"), console=quiet())
    console = quiet()
    options = EditOptions(tint="#b3202a", tint_strength=0.5, thin=0.5, width=1.5, longest=0.05)
    edits = run_edit(folder, options, console=console)
    assert edits == (
        Brightness(0.7, region="left"),
        Trim(0.8, region="left"),
        Tint("#b3202a", 0.5),
        Trim(longest=0.05),
        Thin(0.5),
        Width(1.5),
    )
    assert Avatar.load(folder).edits == edits
    assert (folder / "avatar.safetensors").read_bytes() == tensors
    assert sorted(path.name for path in folder.iterdir()) == ["avatar.json", "avatar.safetensors"]
    for line in ("1  brightness x 0.7 (left)", "6  width x 1.5", "what remains: 10 of 20 strands", "edit.png"):
        assert line in printed(console)
    with Image.open(folder.parent / "edit.png") as sheet:
        assert sheet.width > 4 * 40  # two columns, each shown at twice its size
        assert sheet.height > 4 * 40


def test_edits_are_taken_back(folder: Path) -> None:
    description = json.loads((folder / "avatar.json").read_text())
    run_edit(folder, EditOptions(brightness=0.7, trim=0.8, width=2.0), console=quiet())
    assert run_edit(folder, EditOptions(undo=1), console=quiet()) == (Brightness(0.7), Trim(0.8))
    # back and on in one go
    assert run_edit(folder, EditOptions(undo=1, trim=0.5), console=quiet()) == (Brightness(0.7), Trim(0.5))
    with pytest.raises(DynhairError, match="3 edits cannot be taken back\nexpected: 0 to 2"):
        run_edit(folder, EditOptions(undo=3), console=quiet())
    assert run_edit(folder, EditOptions(clear=True), console=quiet()) == ()
    assert json.loads((folder / "avatar.json").read_text()) == description


def test_listing_writes_nothing(folder: Path) -> None:
    run_edit(folder, EditOptions(brightness=0.7), console=quiet())
    (folder.parent / "edit.png").unlink()
    before = (folder / "avatar.json").stat().st_mtime_ns
    for only in (True, False):
        console = quiet()
        assert run_edit(folder, EditOptions(list_only=only), console=console) == (Brightness(0.7),)
        assert "brightness x 0.7" in printed(console)
    assert (folder / "avatar.json").stat().st_mtime_ns == before
    assert not (folder.parent / "edit.png").exists()
    with pytest.raises(DynhairError, match="listed, and changed"):
        run_edit(folder, EditOptions(list_only=True, undo=1), console=quiet())


def test_an_edited_copy_leaves_the_original(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "there" / "short"
    run_edit(folder, EditOptions(trim=0.5), out=out, console=quiet())
    assert Avatar.load(folder).edits == ()
    assert Avatar.load(out).edits == (Trim(0.5),)
    assert (out / "avatar.safetensors").read_bytes() == (folder / "avatar.safetensors").read_bytes()
    assert (out.parent / "edit.png").exists()
    with pytest.raises(DynhairError, match="something already"):
        run_edit(folder, EditOptions(trim=0.5), out=out, console=quiet())


def test_an_avatar_that_knows_no_recording_is_edited_without_a_picture(folder: Path) -> None:
    avatar = Avatar.load(folder)
    avatar.recording = None
    avatar.save(folder)
    console = quiet()
    run_edit(folder, EditOptions(trim=0.5), console=console)
    assert "n/a: a picture" in printed(console)
    assert Avatar.load(folder).edits == (Trim(0.5),)


@pytest.mark.parametrize(
    "options", [{"trim": 1.5}, {"tint": "red"}, {"width": 2.0, "region": "nape"}, {"thin": 0.5, "region": "ids:99"}]
)
def test_what_is_refused_changes_nothing(options: dict, folder: Path) -> None:
    before = (folder / "avatar.json").read_bytes()
    with pytest.raises(DynhairError):
        run_edit(folder, EditOptions(**options), console=quiet())
    assert (folder / "avatar.json").read_bytes() == before


def test_what_is_no_avatar_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="no such folder"):
        run_edit(tmp_path / "none", EditOptions(trim=0.5), console=quiet())
