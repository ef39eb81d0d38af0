"""The examples, run as they stand, on a tiny avatar."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from dynhair.avatar import Avatar
from synthetic import write_synthetic_capture
from tiny_avatars import make_avatar

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def avatar(tmp_path: Path) -> Path:
    make_avatar().save(tmp_path / "avatar")
    return tmp_path / "avatar"


def main_of(name: str) -> Callable[..., None]:
    path = EXAMPLES / name
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40
    return runpy.run_path(str(path))["main"]


def test_render_image(avatar: Path, tmp_path: Path) -> None:
    main_of("render_image.py")(avatar, tmp_path / "a.png")
    main_of("render_image.py")(avatar, tmp_path / "b.png", degrees=0.0)
    a, b = (np.asarray(Image.open(tmp_path / name)) for name in ("a.png", "b.png"))
    assert a.shape == b.shape == (40, 40, 3)
    assert (a != b).any()


def test_drive_live(avatar: Path, tmp_path: Path) -> None:
    main_of("drive_live.py")(avatar, tmp_path / "nod.mp4", seconds=0.5)
    with av.open(str(tmp_path / "nod.mp4")) as video:
        assert len(list(video.decode(video=0))) == 5


def test_edit_and_export(avatar: Path, tmp_path: Path) -> None:
    main_of("edit_and_export.py")(avatar, tmp_path / "short")
    edited = Avatar.load(tmp_path / "short" / "avatar")
    assert [edit.name for edit in edited.edits] == ["trim", "tint"]
    assert sorted(path.name for path in (tmp_path / "short").iterdir()) == ["avatar", "motion.npz", "npz", "ply"]
    assert len(list((tmp_path / "short" / "ply").iterdir())) == 5


def test_measure(avatar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_synthetic_capture(tmp_path / "capture", frames=2, views=2, with_gt=False)
    main_of("measure.py")(avatar, tmp_path / "capture")
    assert capsys.readouterr().out.startswith("nod: PSNR ")


def test_there_are_no_others() -> None:
    tested = {"render_image.py", "drive_live.py", "edit_and_export.py", "measure.py"}
    assert {path.name for path in EXAMPLES.glob("*.py")} == tested
