"""Animations: videos, pictures with transparency, interruptions."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import torch
from PIL import Image
from rich.console import Console

from dynhair.animation import driving_track, outputs
from dynhair.animation.outputs import straight_alpha
from dynhair.animation.run import run_animation
from dynhair.avatar import Avatar
from dynhair.avatar.frozen import FrozenAvatar
from dynhair.errors import DynhairError
from tiny_avatars import make_avatar

FRAMES = 6  # half a second at the tiny avatar's 10 frames a second


@pytest.fixture(scope="module")
def avatar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("avatars") / "tiny"
    make_avatar().save(path)
    return path


def animate(avatar: Path, out: Path, **options: Any) -> tuple[list[Path], str]:
    printed = io.StringIO()
    given = {"motion": "nod", "seconds": 0.5, "out": out, **options}
    return run_animation(avatar, console=Console(file=printed, width=200), **given), printed.getvalue()


def drawn(avatar: Path, index: int) -> torch.Tensor:
    """The frame as the avatar itself draws it."""
    loaded = Avatar.load(avatar)
    assert loaded.recording is not None
    track = driving_track("nod", loaded.recording, loaded, seconds=0.5)
    with torch.no_grad():
        return loaded.draw(loaded.pose(track, index), [loaded.recording.camera]).rgb[0]


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        assert picture.mode == "RGBA"
        return np.asarray(picture).astype(np.float64) / 255


def film(path: Path) -> list[np.ndarray]:
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def test_a_video_shows_what_the_avatar_draws(avatar: Path, tmp_path: Path) -> None:
    written, printed = animate(avatar, tmp_path / "nod.mp4", size=80)
    assert written == [tmp_path / "nod.mp4"] == list(tmp_path.iterdir())
    frames = film(written[0])
    assert (len(frames), frames[0].shape) == (FRAMES, (80, 80, 3))
    assert f"wrote {tmp_path / 'nod.mp4'}" in printed
    assert f"{FRAMES} of {FRAMES}" in printed


def test_pictures_stand_on_any_background(avatar: Path, tmp_path: Path) -> None:
    animate(avatar, tmp_path / "nod")
    background = np.array([0.1, 0.2, 0.3])
    for index in (0, FRAMES - 1):
        found = pixels(tmp_path / "nod" / f"{index:05d}.png")
        over = found[..., :3] * found[..., 3:] + (1 - found[..., 3:]) * background
        np.testing.assert_allclose(over, drawn(avatar, index).numpy(), atol=1.01 / 255)
    names = sorted(path.name for path in (tmp_path / "nod").iterdir())
    assert names == [*(f"{index:05d}.png" for index in range(FRAMES)), "animation.json"]


def test_both_at_once(avatar: Path, tmp_path: Path) -> None:
    written, _ = animate(avatar, tmp_path / "nod.mp4", png=True)
    assert written == [tmp_path / "nod.mp4", tmp_path / "nod"]
    assert len(film(written[0])) == len(list(written[1].glob("*.png"))) == FRAMES


def test_an_interrupted_folder_goes_on_with_what_is_missing(
    avatar: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw, indices = FrozenAvatar.draw, []

    def interrupted(self: FrozenAvatar, *arguments: Any, **options: Any) -> Any:
        if len(indices) == 3:
            raise KeyboardInterrupt
        indices.append(len(indices))
        return draw(self, *arguments, **options)

    with monkeypatch.context() as patched:
        patched.setattr(FrozenAvatar, "draw", interrupted)
        with pytest.raises(KeyboardInterrupt):
            animate(avatar, tmp_path / "nod")
    there = sorted((tmp_path / "nod").glob("*.png"))
    assert 0 < len(there) <= 3
    assert not list((tmp_path / "nod").glob(".*"))
    before = [path.stat().st_mtime_ns for path in there]
    animate(avatar, tmp_path / "nod")
    assert [path.stat().st_mtime_ns for path in there] == before
    animate(avatar, tmp_path / "whole")
    for index in range(FRAMES):
        found, expected = (pixels(tmp_path / name / f"{index:05d}.png") for name in ("nod", "whole"))
        np.testing.assert_array_equal(found, expected)


def test_a_folder_of_another_animation_or_of_other_things_is_left_alone(avatar: Path, tmp_path: Path) -> None:
    animate(avatar, tmp_path / "nod", seconds=0.1)
    with pytest.raises(DynhairError, match="another animation"):
        animate(avatar, tmp_path / "nod", seconds=0.1, rigid_hair=True)
    (tmp_path / "holiday").mkdir()
    (tmp_path / "holiday" / "00000.png").write_bytes(b"mine")
    with pytest.raises(DynhairError, match="something else"):
        animate(avatar, tmp_path / "holiday")
    assert (tmp_path / "holiday" / "00000.png").read_bytes() == b"mine"
    with pytest.raises(DynhairError, match="no ending of a video"):
        animate(avatar, tmp_path / "nod.avi")


@pytest.mark.parametrize("error", [KeyboardInterrupt, DynhairError("enough")])
def test_an_error_leaves_no_video_and_no_preview(
    avatar: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Any
) -> None:
    draw, drawn = FrozenAvatar.draw, []

    def fails(self: FrozenAvatar, *arguments: Any, **options: Any) -> Any:
        drawn.append(self)
        if len(drawn) == 3:
            assert (tmp_path / "nod.preview.png").exists()
            raise error
        return draw(self, *arguments, **options)

    monkeypatch.setattr(FrozenAvatar, "draw", fails)
    with pytest.raises(type(error) if isinstance(error, DynhairError) else error):
        animate(avatar, tmp_path / "nod.mp4")
    assert list(tmp_path.iterdir()) == []


def test_what_fails_beside_the_drawing_is_told(avatar: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: Any) -> None:
        raise DynhairError("the disk is full")

    monkeypatch.setattr(outputs.Film, "take", full)
    with pytest.raises(DynhairError, match="the disk is full"):
        animate(avatar, tmp_path / "nod.mp4")
    assert list(tmp_path.iterdir()) == []


def test_rigid_hair_looks_different(avatar: Path, tmp_path: Path) -> None:
    animate(avatar, tmp_path / "loose", motion="shake")
    animate(avatar, tmp_path / "rigid", motion="shake", rigid_hair=True)
    frames = [pixels(tmp_path / name / "00003.png") for name in ("loose", "rigid")]
    assert np.abs(frames[0] - frames[1]).max() > 0.05


def test_what_an_avatar_without_its_capture_does_not_know_is_refused(avatar: Path, tmp_path: Path) -> None:
    for options in ({"motion": "jump"}, {"camera": "03"}):
        with pytest.raises(
            DynhairError, match=r"nothing is known by the (motion|camera)(.|\n)*mend it: name the (camera's )?capture"
        ):
            animate(avatar, tmp_path / "out", **options)
    assert list(tmp_path.iterdir()) == []


def test_the_background_is_taken_out_of_colours() -> None:
    background = torch.tensor([1.0, 0.5, 0.0])
    own, alpha = torch.rand(5, 7, 3), torch.linspace(0, 1, 35).reshape(5, 7)
    over = alpha[..., None] * own + (1 - alpha[..., None]) * background
    found = straight_alpha(over, alpha, background)
    covered = alpha > 0.2
    np.testing.assert_allclose(found[..., :3][covered] / 255, own[covered], atol=0.51 / 255)
    np.testing.assert_allclose(found[..., 3] / 255, alpha, atol=0.51 / 255)
    assert (found[0, 0] == 0).all()
