from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.preprocess.sources import raw_scene
from tests.preprocess.sources.raw_scene import CAMERAS, FPS, FRAMES, HEIGHT, WIDTH, write_video

from dynhair.errors import DynhairError
from dynhair.preprocess.options import ImportOptions
from dynhair.preprocess.sources import import_recording, open_recording
from dynhair.preprocess.sources.video import VideoFrames
from dynhair.preprocess.workspace import ViewId, Workspace


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    return raw_scene.videos(tmp_path / "raw").path


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "out")


def run(raw: Path, workspace: Workspace, **options: object) -> tuple[str, ...]:
    return import_recording(open_recording(raw), workspace, ImportOptions(**options), lambda *_: None)  # type: ignore[arg-type]


def modified(workspace: Workspace) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in sorted(workspace.root.rglob("*.*")) if path.suffix != ".json"}


def shows(workspace: Workspace, view: ViewId, take: str, frame: int) -> bool:
    difference = workspace.image(view).astype(int) - raw_scene.picture(take, frame, view.name)
    return int(np.abs(difference).max()) <= 6


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> Counter[tuple[str, str]]:
    """How often each video is read, and how many of its frames are asked for."""
    count: Counter[tuple[str, str]] = Counter()
    read = VideoFrames.read

    def counting(
        self: VideoFrames, indices: Iterable[int], note: Callable[[str], None]
    ) -> Iterator[tuple[int, np.ndarray]]:
        indices = list(indices)
        if indices:
            name = f"{self.path.parent.name}/{self.path.stem}"
            count[name, "passes"] += 1
            count[name, "frames"] += len(indices)
        return read(self, indices, note)

    monkeypatch.setattr(VideoFrames, "read", counting)
    return count


def test_range_and_stride(raw: Path, workspace: Workspace) -> None:
    run(raw, workspace, start=1, stop=5, stride=2)
    manifest = workspace.manifest
    assert manifest.fps == FPS / 2
    assert [(s.name, s.start, s.count) for s in manifest.segments] == [("FREE", 0, 2), ("nod", 2, 2)]
    for frame, (take, source) in enumerate([("FREE", 1), ("FREE", 3), ("nod", 1), ("nod", 3)]):
        assert all(shows(workspace, ViewId(frame, name), take, source) for name in CAMERAS)
    assert not workspace.image_path(ViewId(4, CAMERAS[0])).exists()


def test_takes_and_cameras_are_chosen(raw: Path, workspace: Workspace) -> None:
    run(raw, workspace, takes=("nod",), cameras=("02",))
    assert workspace.manifest.camera_names == ("02",)
    assert [s.name for s in workspace.manifest.segments] == ["nod"]
    assert not workspace.image_path(ViewId(0, "01")).exists()


def test_crop_and_size_change_K(raw: Path, workspace: Workspace) -> None:
    run(raw, workspace, crop=(4, 8, 40, 50), size=25)
    assert workspace.manifest.image_size == (20, 25)
    assert workspace.image(ViewId(0, "01")).shape == (25, 20, 3)
    fx, fy, cx, cy = raw_scene.intrinsics("01")[[0, 1, 0, 1], [0, 1, 2, 2]]
    expected = [[fx / 2, 0, (cx - 4) / 2], [0, fy / 2, (cy - 8) / 2], [0, 0, 1]]
    np.testing.assert_allclose(workspace.camera(ViewId(0, "01")).K, expected, rtol=1e-6)


def test_a_square_makes_cameras_of_different_sizes_agree(raw: Path, workspace: Workspace) -> None:
    for take in raw_scene.TAKES:
        wider = [np.pad(p, ((0, 0), (10, 10), (0, 0))) for p in raw_scene.take_pictures(take, "02")]
        write_video(raw / "videos" / take / "02.mp4", wider)
    text = (raw / "calibration.json").read_text()
    head, tail = text.rsplit(f'"size": [{WIDTH}, {HEIGHT}]', 1)
    (raw / "calibration.json").write_text(head + f'"size": [{WIDTH + 20}, {HEIGHT}]' + tail)
    with pytest.raises(DynhairError, match=f"gives pictures of {WIDTH + 20} x {HEIGHT}"):
        run(raw, workspace)
    run(raw, workspace, crop="square", size=32)
    assert workspace.manifest.image_size == (32, 32)


def test_held_out_takes(raw: Path, tmp_path: Path) -> None:
    def splits(name: str, **options: object) -> dict[str, str]:
        workspace = Workspace(tmp_path / name)
        notes.extend(run(raw, workspace, stop=1, **options))
        return {s.name: s.split for s in workspace.manifest.segments}

    notes: list[str] = []
    assert splits("free") == {"FREE": "test", "nod": "train"}
    assert splits("chosen", test_takes=("nod",)) == {"FREE": "train", "nod": "test"}
    assert splits("none", test_takes=()) == {"FREE": "train", "nod": "train"}
    assert splits("single", takes=("nod",)) == {"nod": "train"}
    assert "nothing is held out" in notes[-1]
    (raw / "videos" / "FREE").rename(raw / "videos" / "also")
    assert splits("last") == {"also": "train", "nod": "test"}


def test_each_video_is_decoded_once_and_not_again(
    raw: Path, workspace: Workspace, decoded: Counter[tuple[str, str]]
) -> None:
    run(raw, workspace, stop=4)
    videos = {f"{take}/{name}" for take in raw_scene.TAKES for name in CAMERAS}
    assert decoded == {(video, what): n for video in videos for what, n in (("passes", 1), ("frames", 4))}
    before = modified(workspace)
    decoded.clear()
    run(raw, workspace, stop=4)
    assert not decoded
    assert modified(workspace) == before


def test_only_what_is_missing_is_written(raw: Path, workspace: Workspace, decoded: Counter[tuple[str, str]]) -> None:
    run(raw, workspace)
    before = modified(workspace)
    lost = [ViewId(1, "01"), ViewId(3, "01"), ViewId(FRAMES, "02")]
    lost_paths = {workspace.image_path(view) for view in lost} | {workspace.camera_path(lost[2])}
    for path in lost_paths:
        path.unlink()
    decoded.clear()
    calls: list[tuple[int, int]] = []

    import_recording(open_recording(raw), workspace, ImportOptions(), lambda *call: calls.append(call))

    total = len(workspace.views)
    assert calls[0] == (total - 3, total)
    assert calls[-1] == (total, total)
    assert decoded == {
        ("FREE/01", "passes"): 1,
        ("FREE/01", "frames"): 2,
        ("nod/02", "passes"): 1,
        ("nod/02", "frames"): 1,
    }
    after = modified(workspace)
    assert {path for path in after if after[path] != before[path]} == lost_paths
    assert shows(workspace, ViewId(3, "01"), "FREE", 3)


def test_a_video_that_was_replaced_is_imported_again_and_no_other(raw: Path, workspace: Workspace) -> None:
    run(raw, workspace)
    before = modified(workspace)
    (video,) = raw.glob("**/nod/01.*")
    newest = max(before.values())
    os.utime(video, ns=(newest + 10**9, newest + 10**9))
    run(raw, workspace)
    changed = {path for path, time in modified(workspace).items() if time != before[path]}
    assert changed == {workspace.image_path(view) for view in workspace.views if view.name == "01"} & {
        workspace.image_path(ViewId(frame, "01")) for frame in range(FRAMES, 2 * FRAMES)
    }


def test_other_options_write_anew(raw: Path, workspace: Workspace) -> None:
    run(raw, workspace)
    run(raw, workspace, size=32)
    assert workspace.image(ViewId(2, "02")).shape == (32, 22, 3)
    pictures = {path: time for path, time in modified(workspace).items() if path.suffix == ".jpg"}
    run(raw, workspace, size=32, metres_per_unit=2.0)  # pictures do not depend on it
    assert {path: time for path, time in modified(workspace).items() if path.suffix == ".jpg"} == pictures
    np.testing.assert_allclose(
        workspace.camera(ViewId(2, "02")).w2c[:, 3], 2 * raw_scene.world_to_camera("02")[:, 3], rtol=1e-6
    )


def test_an_error_in_one_video_ends_all(raw: Path, workspace: Workspace) -> None:
    path = raw / "videos" / "nod" / "02.mp4"
    pictures = [np.random.default_rng(i).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8) for i in range(FRAMES)]
    write_video(path, pictures, options={"movflags": "+faststart"})
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DynhairError, match=r"nod/02\.mp4: (ends after|cannot be decoded)"):
        run(raw, workspace)
    assert not (workspace.folder / "imported.json").exists()


def test_videos_a_little_longer_than_others_are_cut(raw: Path, workspace: Workspace) -> None:
    pictures = raw_scene.take_pictures("nod", "01")
    write_video(raw / "videos" / "nod" / "01.mp4", [*pictures, pictures[-1]])
    notes = run(raw, workspace)
    assert {s.name: s.count for s in workspace.manifest.segments}["nod"] == FRAMES
    assert any("`nod`" in note and f"{FRAMES} to {FRAMES + 1} frames" in note for note in notes)


def test_uneven_times_are_noted(raw: Path, workspace: Workspace) -> None:
    for name in CAMERAS:
        write_video(raw / "videos" / "nod" / f"{name}.mp4", raw_scene.take_pictures("nod", name), times=[0, 1, 2, 4, 5])
    recording = open_recording(raw, fps=FPS)
    notes = import_recording(recording, workspace, ImportOptions(), lambda *_: None)
    uneven = [note for note in notes if "not evenly spaced" in note]
    assert len(uneven) == len(CAMERAS)
    assert all("the first after frame 2" in note for note in uneven)


def test_videos_that_lie_on_their_side_are_turned(tmp_path: Path) -> None:
    upright = raw_scene.take_pictures("nod", "01")
    write_video(tmp_path / "lying.mp4", [np.rot90(pixels, -1) for pixels in upright], rotation=90)
    frames = VideoFrames(tmp_path / "lying.mp4")
    assert frames.size == (WIDTH, HEIGHT)
    for index, pixels in frames.read([0, 4], print):
        np.testing.assert_array_equal(pixels, upright[index])


def test_the_rate_of_broadcast_video_is_kept(tmp_path: Path) -> None:
    write_video(tmp_path / "ntsc.mp4", raw_scene.take_pictures("nod", "01"), fps=30000 / 1001)
    assert VideoFrames(tmp_path / "ntsc.mp4").fps == pytest.approx(30000 / 1001, rel=1e-9)


def test_masks_follow_their_pictures(tmp_path: Path, workspace: Workspace) -> None:
    written = raw_scene.vhap(tmp_path / "vhap")
    options = ImportOptions(crop="square", size=22)
    import_recording(open_recording(written.path, fps=FPS), workspace, options, lambda *_: None)
    view = ViewId(2, "02")
    mask = np.asarray(Image.open(workspace.given_path(view, "mask"))).astype(int)
    assert np.abs(mask - workspace.image(view)[..., 0]).max() <= 8  # the scene's mask is its red channel


def test_calibrated_cameras_without_videos_are_noted(raw: Path, workspace: Workspace) -> None:
    for take in raw_scene.TAKES:
        (raw / "videos" / take / "02.mp4").unlink()
    assert "calibrated cameras without pictures: 02" in run(raw, workspace)
    assert workspace.manifest.camera_names == ("01",)
