"""Whatever is wrong with a recording is refused by naming the file, the field and the reason."""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.preprocess.sources import raw_scene
from tests.preprocess.sources.raw_scene import FPS, FRAMES, opencv_matrix, write_png, write_video

from dynhair.errors import DynhairError
from dynhair.preprocess.options import ImportOptions
from dynhair.preprocess.sources import import_recording, open_recording
from dynhair.preprocess.workspace import Workspace

Break = Callable[[Path], object]


@pytest.fixture(scope="module")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Recordings that no test may change, written when they are first asked for."""
    made: dict[str, Path] = {}

    def make(kind: str) -> Path:
        if kind not in made:
            layout, _, calibration = kind.partition("+")
            root = tmp_path_factory.mktemp("raw") / "raw"
            path = raw_scene.LAYOUTS[layout](root).path
            if calibration:
                (path / "calibration.json").unlink()
                raw_scene.CALIBRATIONS[calibration](path)
            made[kind] = root
        return made[kind]

    return make


def edit_json(name: str, change: Callable[[Any], object]) -> Break:
    def apply(root: Path) -> None:
        (path,) = root.rglob(name)
        value = json.loads(path.read_text())
        change(value)
        path.write_text(json.dumps(value))

    return apply


def edit_text(name: str, old: str, new: str) -> Break:
    def apply(root: Path) -> None:
        (path,) = root.rglob(name)
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return apply


def cut(name: str, size: int) -> Break:
    def apply(root: Path) -> None:
        (path,) = root.rglob(name)
        path.write_bytes(path.read_bytes()[:size])

    return apply


def overwrite(name: str, at: int, value: bytes) -> Break:
    def apply(root: Path) -> None:
        (path,) = root.rglob(name)
        data = bytearray(path.read_bytes())
        data[at : at + len(value)] = value
        path.write_bytes(data)

    return apply


def remove(pattern: str) -> Break:
    def apply(root: Path) -> None:
        for path in list(root.rglob(pattern)):
            shutil.rmtree(path) if path.is_dir() else path.unlink()

    return apply


def replace_npz(name: str, **arrays: np.ndarray) -> Break:
    def apply(root: Path) -> None:
        (path,) = (p for p in root.rglob(name) if "cameras" in str(p) and p.parent.name in ("cameras", "0003"))
        with np.load(path) as archive:
            np.savez(path, **{**archive, **arrays})  # type: ignore[arg-type]

    return apply


def camera(change: Callable[[dict[str, Any]], object]) -> Break:
    return edit_json("calibration.json", lambda raw: change(raw["cameras"]["02"]))


def video(path: str, frames: int = FRAMES, fps: float = FPS, size: tuple[int, int] | None = None) -> Break:
    def apply(root: Path) -> None:
        pictures = (raw_scene.take_pictures("nod", "02") * 3)[:frames]
        if size is not None:
            pictures = [np.zeros((size[1], size[0], 3), np.uint8)] * frames
        write_video(root / path, pictures, fps=fps)

    return apply


def set_value(target: dict[str, Any], key: str, value: object) -> None:
    target[key] = value


def reflect(target: dict[str, Any]) -> None:
    target["world_to_camera"][0] = [-v for v in target["world_to_camera"][0]]


def stretch(target: dict[str, Any]) -> None:
    target["world_to_camera"] = (2 * np.array(target["world_to_camera"])).tolist()


W2C, K = raw_scene.world_to_camera("02"), raw_scene.intrinsics("02")
_DISTORTION = "distortion_coefficients"
NAN = np.full((3, 4), np.nan)

# layout, what breaks it, and three parts of the message: file, field, reason
CASES: dict[str, tuple[str, Break, tuple[str, str, str]]] = {
    # our own calibration file
    "json_missing": ("videos", remove("calibration.json"), ("raw", "calibration.json", "no calibration is there")),
    "json_broken": ("videos", cut("calibration.json", 40), ("calibration.json", "JSON", "not readable")),
    "json_version": (
        "videos",
        edit_json("calibration.json", lambda raw: raw.update(version=2)),
        ("calibration.json", "`version`", "is 2"),
    ),
    "json_no_cameras": (
        "videos",
        edit_json("calibration.json", lambda raw: raw.pop("cameras")),
        ("calibration.json", "`cameras`", "is missing"),
    ),
    "json_camera_missing": (
        "videos",
        edit_json("calibration.json", lambda raw: raw["cameras"].pop("02")),
        ("calibration.json", "camera `02`", "has no camera"),
    ),
    "json_misspelt": (
        "videos",
        camera(lambda c: set_value(c, "distorsion", [0.1])),
        ("calibration.json", "`cameras.02.distorsion`", "is not a field"),
    ),
    "json_no_K": ("videos", camera(lambda c: c.pop("K")), ("calibration.json", "`cameras.02.fx`", "is missing")),
    "json_two_Ks": (
        "videos",
        camera(lambda c: set_value(c, "fx", 90.0)),
        ("calibration.json", "`cameras.02`", "both K and fx"),
    ),
    "json_no_pose": (
        "videos",
        camera(lambda c: c.pop("world_to_camera")),
        ("calibration.json", "`cameras.02`", "none of world_to_camera"),
    ),
    "json_two_poses": (
        "videos",
        camera(lambda c: set_value(c, "camera_to_world", c["world_to_camera"])),
        ("calibration.json", "`cameras.02`", "both of"),
    ),
    "json_reflection": (
        "videos",
        camera(reflect),
        ("calibration.json", "`cameras.02.world_to_camera`", "is a reflection"),
    ),
    "json_scaled_rotation": (
        "videos",
        camera(stretch),
        ("calibration.json", "`cameras.02.world_to_camera`", "is not orthonormal"),
    ),
    "json_shape": (
        "videos",
        camera(lambda c: set_value(c, "world_to_camera", [[1, 0, 0, 0]])),
        ("calibration.json", "`cameras.02.world_to_camera`", "has the shape (1, 4)"),
    ),
    "json_transposed": (
        "videos",
        camera(lambda c: set_value(c, "world_to_camera", np.r_[W2C, [[0, 0, 0, 1]]].T.tolist())),
        ("calibration.json", "`cameras.02.world_to_camera`", "the fourth row"),
    ),
    "json_nan": (
        "videos",
        camera(lambda c: c["K"][0].__setitem__(0, float("nan"))),
        ("calibration.json", "`cameras.02.K`", "holds NaN"),
    ),
    "json_skew": (
        "videos",
        camera(lambda c: c["K"][0].__setitem__(1, 3.0)),
        ("calibration.json", "`cameras.02.K`", "without skew"),
    ),
    "json_words": (
        "videos",
        camera(lambda c: set_value(c, "K", "see above")),
        ("calibration.json", "`cameras.02.K`", "is not an array of numbers"),
    ),
    "json_distortion": (
        "videos",
        camera(lambda c: set_value(c, "distortion", [0.1, 0.2, 0.3])),
        ("calibration.json", "`cameras.02.distortion`", "has 3 coefficients"),
    ),
    "json_fisheye_distortion": (
        "videos",
        camera(lambda c: c.update(model="fisheye", distortion=[0.1] * 5)),
        ("calibration.json", "`cameras.02.distortion`", "has 5 coefficients"),
    ),
    "json_model": (
        "videos",
        camera(lambda c: set_value(c, "model", "mirror")),
        ("calibration.json", "`cameras.02.model`", "'mirror'"),
    ),
    "json_size": (
        "videos",
        camera(lambda c: set_value(c, "size", [0, 64])),
        ("calibration.json", "`cameras.02.size`", "0 x 64"),
    ),
    "json_other_size": (
        "videos",
        camera(lambda c: set_value(c, "size", [64, 64])),
        ("02.mp4", "64 x 64", "do not fit a calibration"),
    ),
    "json_up": (
        "videos",
        edit_json("calibration.json", lambda raw: raw.update(up="w")),
        ("calibration.json", "`up`", "'w'"),
    ),
    "json_unit": (
        "videos",
        edit_json("calibration.json", lambda raw: raw.update(metres_per_unit=-1)),
        ("calibration.json", "`metres_per_unit`", "above 0"),
    ),
    # COLMAP
    "colmap_model": (
        "videos+colmap_text",
        edit_text("cameras.txt", "PINHOLE", "FOV"),
        ("cameras.txt", "`MODEL`", "is FOV"),
    ),
    "colmap_parameters": (
        "videos+colmap_text",
        edit_text("cameras.txt", " 32.8", ""),
        ("cameras.txt", "PARAMS[]", "has the shape (3,)"),
    ),
    "colmap_words": (
        "videos+colmap_text",
        edit_text("cameras.txt", " 32.8", " x"),
        ("cameras.txt", "camera 7", "the line is"),
    ),
    "colmap_image_line": (
        "videos+colmap_text",
        edit_text("images.txt", " 7 01.png", ""),
        ("images.txt", "QW, QX", "the line of an image"),
    ),
    "colmap_unknown_lens": (
        "videos+colmap_text",
        edit_text("images.txt", " 7 01.png", " 9 01.png"),
        ("images.txt", "`CAMERA_ID`", "is 9"),
    ),
    "colmap_moving": (
        "videos+colmap_text",
        edit_text("images.txt", "02.png", "01/2.png"),
        ("images.txt", "camera `01`", "another pose"),
    ),
    "colmap_no_cameras": (
        "videos+colmap_text",
        remove("cameras.txt"),
        ("cameras.txt", "file", "is missing"),
    ),
    "colmap_unnamed": (
        "videos+colmap_text",
        edit_text("images.txt", "02.png", "right.png"),
        ("sparse/0", "camera `02`", "there are 01, right"),
    ),
    "colmap_truncated_cameras": (
        "videos+colmap_binary",
        cut("cameras.bin", 50),
        ("cameras.bin", "the parameters of camera 7", "is truncated: it ends at byte 50"),
    ),
    "colmap_truncated_images": (
        "videos+colmap_binary",
        cut("images.bin", 150),
        ("images.bin", "image 2 of 2", "is truncated"),
    ),
    "colmap_truncated_name": (
        "videos+colmap_binary",
        cut("images.bin", 8 + 64 + 4),
        ("images.bin", "image 1 of 2", "is truncated"),
    ),
    "colmap_binary_model": (
        "videos+colmap_binary",
        overwrite("cameras.bin", 12, struct.pack("<i", 10)),
        ("cameras.bin", "`MODEL`", "is 10"),
    ),
    "colmap_binary_nan": (
        "videos+colmap_binary",
        overwrite("images.bin", 12, struct.pack("<d", float("nan"))),
        ("images.bin", "QW, QX", "holds NaN"),
    ),
    "colmap_quaternion": (
        "videos+colmap_binary",
        overwrite("images.bin", 12, struct.pack("<d", 5.0)),
        ("images.bin", "`QW, QX, QY, QZ`", "has the length"),
    ),
    # OpenCV
    "opencv_no_extri": ("videos+easymocap", remove("extri.yml"), ("intri.yml", "`Rot_01`", "is missing")),
    "opencv_node": (
        "videos+easymocap",
        edit_text("intri.yml", "dist_02", "distances_02"),
        ("intri.yml", "`dist_02`", "is missing"),
    ),
    "opencv_shape": (
        "videos+easymocap",
        edit_text("intri.yml", "rows: 3", "rows: 2"),
        ("intri.yml", "`K_01`", "cannot be read"),
    ),
    "opencv_not_yaml": (
        "videos+easymocap",
        edit_text("extri.yml", "%YAML:1.0", "cameras"),
        ("extri.yml", "cv2.FileStorage", "cannot be read"),
    ),
    "opencv_rotation": (
        "videos+easymocap",
        lambda root: (root / "extri.yml").write_text(
            "%YAML:1.0\n---\n"
            + "".join(
                opencv_matrix(f"Rot_{name}", np.eye(3) * 1.1) + opencv_matrix(f"T_{name}", np.ones((3, 1)))
                for name in raw_scene.CAMERAS
            )
        ),
        ("extri.yml", "`Rot_01`", "is not orthonormal"),
    ),
    "opencv_distortion": (
        "videos+opencv_each",
        edit_text("02.yml", opencv_matrix(_DISTORTION, np.zeros((5, 1))), opencv_matrix(_DISTORTION, np.zeros((3, 1)))),
        ("02.yml", "`distortion_coefficients`", "has 3 coefficients"),
    ),
    "other_calibration": (
        "videos",
        lambda root: (root / "calibration.json").rename(root / "calibration.yml"),
        ("calibration.yml", "%YAML:1.0", "cannot be read"),
    ),
    # the datasets' own cameras
    "nersemble_no_K": (
        "nersemble2",
        edit_json("camera_params.json", lambda raw: raw.pop("intrinsics")),
        ("camera_params.json", "`intrinsics`", "is missing"),
    ),
    "nersemble_pose": (
        "nersemble2",
        edit_json("camera_params.json", lambda raw: raw["world_2_cam"]["02"].clear()),
        ("camera_params.json", "`world_2_cam.02`", "has the shape (0,)"),
    ),
    "nersemble_poses": (
        "nersemble1",
        edit_json("camera_params.json", lambda raw: set_value(raw, "world_2_cam", [])),
        ("camera_params.json", "`world_2_cam`", "is not an object"),
    ),
    "hhavatar_nan": (
        "hhavatar",
        replace_npz("camera_02.npz", extrinsic=NAN),
        ("camera_02.npz", "`extrinsic`", "NaN or infinite"),
    ),
    "hhavatar_reflection": (
        "hhavatar",
        replace_npz("camera_02.npz", extrinsic=np.diag([1.0, 1.0, -1.0]) @ W2C),
        ("camera_02.npz", "`extrinsic`", "is a reflection"),
    ),
    "hhavatar_K": (
        "hhavatar",
        replace_npz("camera_02.npz", intrinsic=K[:2]),
        ("camera_02.npz", "`intrinsic`", "has the shape (2, 3)"),
    ),
    "hhavatar_camera_missing": (
        "hhavatar",
        remove("camera_02.npz"),
        ("cameras", "camera `02`", "has no camera"),
    ),
    "vhap_no_matrix": (
        "vhap",
        edit_json("transforms.json", lambda raw: raw["frames"][3].pop("transform_matrix")),
        ("transforms.json", "`frames[3].transform_matrix`", "is missing"),
    ),
    "vhap_view_missing": (
        "vhap",
        edit_json("transforms.json", lambda raw: raw["frames"].pop(3)),
        ("nod", "camera_index 2", "no frame of timestep_index 1"),
    ),
    "vhap_empty": (
        "vhap",
        edit_json("transforms.json", lambda raw: raw["frames"].clear()),
        ("transforms.json", "`frames`", "is empty"),
    ),
    "vhap_image_missing": ("vhap", remove("images/00003_02.png"), ("00003_02.png", "file", "is missing")),
    "vhap_mask_size": (
        "vhap",
        lambda root: write_png(root / "nod" / "fg_masks" / "00001_02.png", np.zeros((5, 5), np.uint8)),
        ("fg_masks/00001_02.png", "5 x 5 pixels", "as its picture"),
    ),
    "capture_image_missing": (
        "capture",
        remove("images/0003/image_02.png"),
        ("0003/image_02.jpg", "picture", "is missing"),
    ),
    "capture_camera_missing": (
        "capture",
        remove("cameras/0003/camera_02.npz"),
        ("0003/camera_02.npz", "camera", "is missing"),
    ),
    "capture_camera": (
        "capture",
        lambda root: np.savez(root / "cameras" / "0003" / "camera_02.npz", extrinsic=W2C * 2, intrinsic=K),
        ("0003/camera_02.npz", "`extrinsic`", "is not orthonormal"),
    ),
    "capture_manifest": (
        "capture",
        edit_json("capture.json", lambda raw: raw.pop("fps")),
        ("capture.json", "`fps`", "None"),
    ),
    # pictures and videos
    "video_missing": (
        "videos",
        remove("videos/nod/02.mp4"),
        ("videos/nod", "camera `02`", "take `nod` has nothing from"),
    ),
    "video_not_a_video": ("videos", cut("videos/nod/02.mp4", 100), ("nod/02.mp4", "video", "cannot be decoded")),
    "video_empty": ("videos", cut("videos/nod/02.mp4", 0), ("nod/02.mp4", "video", "cannot be decoded")),
    "video_longer": (
        "videos",
        video("videos/nod/02.mp4", frames=FRAMES + 4),
        ("nod/01.mp4", "camera `02` has 9", "has 5 frames"),
    ),
    "video_rate": (
        "videos",
        video("videos/nod/02.mp4", fps=25.0),
        ("nod/02.mp4", "25 frames per second", "one frame rate"),
    ),
    "video_size": (
        "videos",
        video("videos/nod/02.mp4", size=(22, 32)),
        ("nod/02.mp4", "22 x 32 pixels", "as in take `FREE`"),
    ),
    "image_gap": (
        "images",
        remove("images/nod/02/frame10.png"),
        ("nod/02", "frame9.png", "is missing: the next is frame11.png"),
    ),
    "image_numbers": (
        "images",
        remove("images/nod/02/frame12.png"),
        ("nod/02", "image 12", "and `02` has not"),
    ),
    "image_size": (
        "images",
        lambda root: write_png(root / "images" / "nod" / "02" / "frame9.png", np.zeros((5, 6, 3), np.uint8)),
        ("nod/02/frame9.png", "6 x 5 pixels", "as the first of its camera"),
    ),
    "image_damaged": ("images", cut("images/nod/02/frame9.png", 200), ("frame9.png", "JPEG or PNG", "is damaged")),
}


@pytest.mark.parametrize("case", CASES)
def test_a_malformed_recording_is_refused(case: str, pristine: Callable[[str], Path], tmp_path: Path) -> None:
    layout, break_it, parts = CASES[case]
    root = Path(shutil.copytree(pristine(layout), tmp_path / "raw"))
    break_it(root)
    path = {"nersemble2": root / "018", "nersemble1": root / "videos" / "018", "vhap": root / "nod"}.get(layout, root)
    rate = FPS if layout.split("+")[0] in ("images", "vhap") else None
    with pytest.raises(DynhairError) as caught:
        recording = open_recording(path, fps=rate)
        import_recording(recording, Workspace(tmp_path / "out"), ImportOptions(), lambda *_: None)
    message = str(caught.value)
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"takes": ("HAIR",)}, "there is no take `HAIR`"),
        ({"takes": ()}, "no take or no camera"),
        ({"cameras": ("03",)}, "there is no camera `03`"),
        ({"test_takes": ("HAIR",)}, "there is no take `HAIR` to hold out"),
        ({"test_takes": ("nod", "FREE")}, "all takes are held out"),
        ({"start": FRAMES}, f"has {FRAMES} frames"),
        ({"start": 3, "stop": 3}, "0 <= start < stop"),
        ({"stride": 0}, "a stride of 0"),
        ({"size": 0}, "a size of 0"),
        ({"crop": (0, 0, 999, 9)}, "the crop 0, 0, 999, 9 is not inside"),
        ({"metres_per_unit": 0.0}, "0.0 metres per unit"),
    ],
)
def test_impossible_options_are_refused(
    options: dict[str, Any], message: str, pristine: Callable[[str], Path], tmp_path: Path
) -> None:
    with pytest.raises(DynhairError, match=message):
        import_recording(
            open_recording(pristine("videos")), Workspace(tmp_path), ImportOptions(**options), lambda *_: None
        )


def test_pictures_need_a_rate(pristine: Callable[[str], Path], tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="the frame rate is not known"):
        import_recording(open_recording(pristine("images")), Workspace(tmp_path), ImportOptions(), lambda *_: None)
    with pytest.raises(DynhairError, match="`fps` is -1"):
        open_recording(pristine("images"), fps=-1.0)


def test_a_camera_that_is_not_used_need_not_be_calibrated(pristine: Callable[[str], Path], tmp_path: Path) -> None:
    root = Path(shutil.copytree(pristine("videos"), tmp_path / "raw"))
    edit_json("calibration.json", lambda raw: raw["cameras"].pop("02"))(root)
    workspace = Workspace(tmp_path / "out")
    import_recording(open_recording(root), workspace, ImportOptions(cameras=("01",)), lambda *_: None)
    assert workspace.manifest.camera_names == ("01",)
