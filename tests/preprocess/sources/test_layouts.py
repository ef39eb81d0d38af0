from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.preprocess.sources import raw_scene
from tests.preprocess.sources.raw_scene import CALIBRATIONS, CAMERAS, FPS, FRAMES, HEIGHT, LAYOUTS, WIDTH

from dynhair.capture.arrays import read_npz
from dynhair.errors import DynhairError
from dynhair.preprocess.options import ImportOptions
from dynhair.preprocess.sources import import_recording, open_recording
from dynhair.preprocess.workspace import STATIC, ViewId, Workspace

CODEC_TOLERANCE = 6  # grey levels; JPEG at quality 95 of smooth pictures


def assert_holds_the_scene(workspace: Workspace, takes: tuple[str, ...], *, shared_K: bool) -> None:
    for t, take in enumerate(takes):
        for frame in range(FRAMES):
            for name in CAMERAS:
                view = ViewId(t * FRAMES + frame, name)
                difference = workspace.image(view).astype(int) - raw_scene.picture(take, frame, name)
                assert np.abs(difference).max() <= CODEC_TOLERANCE, view
                stored = read_npz(workspace.camera_path(view), {"extrinsic": (3, 4), "intrinsic": (3, 3)})
                K = raw_scene.shared_intrinsics() if shared_K else raw_scene.intrinsics(name)
                np.testing.assert_allclose(stored["extrinsic"], raw_scene.world_to_camera(name), rtol=0, atol=1e-9)
                np.testing.assert_allclose(stored["intrinsic"], K, rtol=0, atol=1e-9)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_imports_to_the_same_capture(layout: str, tmp_path: Path) -> None:
    written = LAYOUTS[layout](tmp_path / "raw")
    workspace = Workspace(tmp_path / "out")
    recording = open_recording(written.path, fps=written.fps)
    calls: list[tuple[int, int]] = []

    import_recording(recording, workspace, ImportOptions(), lambda done, total: calls.append((done, total)))

    takes = written.takes if layout == "capture" else tuple(sorted(written.takes))
    manifest = workspace.manifest
    assert (manifest.fps, manifest.image_size, manifest.camera_names) == (FPS, (WIDTH, HEIGHT), CAMERAS)
    assert [(s.start, s.count) for s in manifest.segments] == [(i * FRAMES, FRAMES) for i in range(len(takes))]
    if len(takes) > 1:
        assert [s.name for s in manifest.segments] == list(takes)
        tests = written.tests or ("FREE",)
        assert {s.name: s.split for s in manifest.segments} == {n: "test" if n in tests else "train" for n in takes}
    else:
        assert manifest.segments[0].split == "train"
    assert_holds_the_scene(workspace, takes, shared_K=layout.startswith("nersemble"))
    total = len(workspace.views)
    assert (calls[0], calls[-1]) == ((0, total), (total, total))


@pytest.mark.parametrize("calibration", CALIBRATIONS)
def test_every_calibration_gives_the_same_cameras(calibration: str, tmp_path: Path) -> None:
    raw = raw_scene.images(tmp_path / "raw").path
    (raw / "calibration.json").unlink()
    path = CALIBRATIONS[calibration](raw)
    for given in (None, path):  # found at its usual place, or named
        workspace = Workspace(tmp_path / f"out-{given is None}")
        recording = open_recording(raw, calibration=given, fps=FPS)
        import_recording(recording, workspace, ImportOptions(takes=("nod",)), lambda *_: None)
        assert_holds_the_scene(workspace, ("nod",), shared_K=False)


@pytest.mark.parametrize("layout", ["images", "nersemble2"])
def test_clean_plates_are_kept(layout: str, tmp_path: Path) -> None:
    written = LAYOUTS[layout](tmp_path / "raw")
    workspace = Workspace(tmp_path / "out")
    import_recording(open_recording(written.path, fps=FPS), workspace, ImportOptions(size=32), lambda *_: None)
    for name in CAMERAS:
        plate = np.asarray(Image.open(workspace.plate_path(name)))
        np.testing.assert_array_equal(plate, raw_scene.plate(name)[:32, :22])


@pytest.mark.parametrize("layout", ["vhap", "capture"])
def test_masks_that_came_along_are_given(layout: str, tmp_path: Path) -> None:
    written = LAYOUTS[layout](tmp_path / "raw")
    workspace = Workspace(tmp_path / "out")
    import_recording(open_recording(written.path, fps=written.fps), workspace, ImportOptions(), lambda *_: None)
    for frame in range(FRAMES):
        for name in CAMERAS:
            given = np.asarray(Image.open(workspace.given_path(ViewId(frame, name), "mask")))
            np.testing.assert_array_equal(given, raw_scene.mask("nod", frame, name))
    assert not workspace.given_path(ViewId(0, CAMERAS[0]), "hair").exists()


def test_a_capture_keeps_its_ring_gravity_background_and_notes(tmp_path: Path) -> None:
    written = raw_scene.capture(tmp_path / "raw")
    workspace = Workspace(tmp_path / "out")
    options = ImportOptions(takes=("FREE",), stride=2)
    import_recording(open_recording(written.path), workspace, options, lambda *_: None)
    manifest = workspace.manifest
    assert workspace.static_names == ("ring01", "ring02")
    assert manifest.static_frame == 1  # the third of the take's frames, of which every second is used
    assert manifest.gravity == pytest.approx((0, -9.5, 0))
    assert manifest.background == (0, 0.5, 1)
    assert (manifest.notes or {})["cameras"]["02"] == {"azimuth": 1}
    ring = workspace.image(ViewId(STATIC, "ring02")).astype(int)
    assert np.abs(ring - raw_scene.picture("FREE", 2, "02")).max() <= CODEC_TOLERANCE
    assert workspace.camera_path(ViewId(STATIC, "ring02")).exists()


def test_static_views_go_with_the_frame_they_show(tmp_path: Path) -> None:
    written = raw_scene.capture(tmp_path / "raw")
    workspace = Workspace(tmp_path / "out")
    options = ImportOptions(takes=("nod",), test_takes=())
    notes = import_recording(open_recording(written.path), workspace, options, lambda *_: None)
    assert workspace.static_names == ()
    assert any("static views are left out" in note and "`FREE`" in note for note in notes)


def test_a_folder_without_a_manifest_is_taken_at_25_frames_a_second(tmp_path: Path) -> None:
    path = raw_scene.capture(tmp_path / "raw").path
    (path / "capture.json").unlink()
    workspace = Workspace(tmp_path / "out")
    notes = import_recording(open_recording(path), workspace, ImportOptions(), lambda *_: None)
    assert workspace.manifest.fps == 25
    assert [s.count for s in workspace.manifest.segments] == [2 * FRAMES]
    assert any("25 frames a second" in note for note in notes)


def test_jpegs_that_need_no_change_are_copied(tmp_path: Path) -> None:
    path = raw_scene.capture(tmp_path / "raw").path
    for file in path.rglob("image_*.png"):
        Image.open(file).save(file.with_suffix(".jpg"), quality=80)
        file.unlink()
    workspace = Workspace(tmp_path / "out")
    import_recording(open_recording(path), workspace, ImportOptions(), lambda *_: None)
    source = path / "images" / "0003" / "image_01.jpg"
    assert workspace.image_path(ViewId(3, "01")).read_bytes() == source.read_bytes()


def test_takes_get_names_that_a_manifest_accepts(tmp_path: Path) -> None:
    path = raw_scene.nersemble2(tmp_path / "raw").path
    (path / "sequences" / "nod").rename(path / "sequences" / "EMO-1-shout+laugh")
    workspace = Workspace(tmp_path / "out")
    options = ImportOptions(takes=("EMO-1-shout+laugh",))
    import_recording(open_recording(path), workspace, options, lambda *_: None)
    assert [s.name for s in workspace.manifest.segments] == ["EMO-1-shout_laugh"]


def test_the_world_turns_so_that_up_is_y(tmp_path: Path) -> None:
    written = raw_scene.images(tmp_path / "raw")
    recording = open_recording(written.path, fps=FPS)
    for up, axis in {"x": 0, "y": 1, "z": 2}.items():
        for sign, name in ((1, up), (-1, f"-{up}")):
            workspace = Workspace(tmp_path / name)
            options = ImportOptions(takes=("nod",), stop=1, metres_per_unit=0.5, up=name)  # type: ignore[arg-type]
            import_recording(recording, workspace, options, lambda *_: None)
            camera = workspace.camera(ViewId(0, "01"))
            old = raw_scene.world_to_camera("01")
            upwards = sign * old[:, axis]  # of the recording's world, in the camera's axes
            np.testing.assert_allclose(camera.w2c[:, 1], upwards, atol=1e-6)
            np.testing.assert_allclose(np.linalg.det(camera.w2c[:, :3]), 1, atol=1e-6)
            np.testing.assert_allclose(camera.w2c[:, 3], 0.5 * old[:, 3], atol=1e-6)


def test_an_unknown_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="no recording of a known layout"):
        open_recording(tmp_path)
    with pytest.raises(DynhairError, match="the folder is missing"):
        open_recording(tmp_path / "nowhere")
