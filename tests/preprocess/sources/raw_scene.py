"""One small scene, filmed by two cameras in two takes, written in every layout and calibration format."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.video.stream import VideoStream
from PIL import Image
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT = 44, 64
FPS = 30.0
FRAMES = 5
CAMERAS = ("01", "02")
TAKES = ("nod", "FREE")
COLMAP_MODELS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "RADIAL": 3, "OPENCV": 4, "OPENCV_FISHEYE": 5}


def intrinsics(camera: str) -> np.ndarray:
    focal = 90.0 + 3 * CAMERAS.index(camera)
    return np.array([[focal, 0, 21.3], [0, focal + 1, 32.8], [0, 0, 1]])


def world_to_camera(camera: str) -> np.ndarray:
    """At head height, 1.2 m away, to the left and to the right, looking at the origin."""
    turn = Rotation.from_euler("yx", [-20.0 + 35 * CAMERAS.index(camera), 4.0], degrees=True).as_matrix()
    flip = np.diag([1.0, -1.0, -1.0])  # from y up to y down
    return np.c_[flip @ turn.T, [0.01, -0.02, 1.2]]


def picture(take: str, frame: int, camera: str) -> np.ndarray:
    """A coloured ramp, and a spot that moves differently in each take."""
    point = np.array([0.06 * frame - 0.1, 0.1 + 0.1 * TAKES.index(take) - 0.03 * frame, 0.05])
    w2c = world_to_camera(camera)
    x, y, z = intrinsics(camera) @ (w2c[:, :3] @ point + w2c[:, 3])
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    spot = np.exp(-((columns - x / z) ** 2 + (rows - y / z) ** 2) / (2 * 4.0**2))
    ramp = np.stack([columns / WIDTH, rows / HEIGHT, np.full_like(rows, 0.3)], -1)
    return np.round(255 * (0.5 * ramp + 0.5 * spot[..., None])).astype(np.uint8)


def mask(take: str, frame: int, camera: str) -> np.ndarray:
    return picture(take, frame, camera)[..., 0]


def plate(camera: str) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), 40 + 50 * CAMERAS.index(camera), np.uint8)


def take_pictures(take: str, camera: str) -> list[np.ndarray]:
    return [picture(take, frame, camera) for frame in range(FRAMES)]


def write_video(
    path: Path,
    pictures: Sequence[np.ndarray],
    *,
    fps: float = FPS,
    times: Sequence[int] | None = None,
    options: Mapping[str, str] | None = None,
    rotation: int = 0,
) -> None:
    """Write an MP4 without loss; ``times`` are in frames."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", options=dict(options or {})) as container:
        stream = cast(VideoStream, container.add_stream("libx264rgb", rate=Fraction(fps).limit_denominator(1001)))
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt, stream.options = "rgb24", {"crf": "0", "preset": "ultrafast"}
        if rotation:
            stream.set_display_rotation(rotation)
        for i, pixels in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
            frame.pts = i if times is None else times[i]
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def write_png(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))


def write_npz_camera(path: Path, camera: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, extrinsic=world_to_camera(camera), intrinsic=intrinsics(camera))


# calibration formats


def json_calibration(path: Path) -> Path:
    cameras = {
        name: {
            "size": [WIDTH, HEIGHT],
            "K": intrinsics(name).tolist(),
            "world_to_camera": world_to_camera(name).tolist(),
        }
        for name in CAMERAS
    }
    write_json(path / "calibration.json", {"version": 1, "cameras": cameras})
    return path / "calibration.json"


def json_calibration_z_up(path: Path) -> Path:
    """The same cameras, camera-to-world, in a world in millimetres with z up, calibrated at twice the size."""
    z_up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # its z is our y, its y our -z
    cameras: dict[str, Any] = {}
    for name in CAMERAS:
        w2c, K = world_to_camera(name), intrinsics(name) * 2
        c2w = np.eye(4)
        c2w[:3, :3] = z_up @ w2c[:, :3].T
        c2w[:3, 3] = -1000 * z_up @ w2c[:, :3].T @ w2c[:, 3]
        focal = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
        cameras[name] = {"size": [2 * WIDTH, 2 * HEIGHT], **focal, "camera_to_world": c2w.tolist()}
        cameras[name]["distortion"] = [0, 0, 0, 0]
    write_json(path / "calibration.json", {"metres_per_unit": 0.001, "up": "z", "cameras": cameras})
    return path / "calibration.json"


def _quaternion(camera: str) -> np.ndarray:
    return Rotation.from_matrix(world_to_camera(camera)[:, :3]).as_quat()[[3, 0, 1, 2]]


def _pinhole(camera: str) -> list[float]:
    K = intrinsics(camera)
    return [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]


def colmap_text(path: Path) -> Path:
    folder = path / "sparse" / "0"
    folder.mkdir(parents=True)
    cameras = ["# Camera list with one line of data per camera:"]
    images = ["# Image list with two lines of data per image:"]
    for i, name in enumerate(CAMERAS):
        cameras.append(" ".join(map(str, [i + 7, "PINHOLE", WIDTH, HEIGHT, *_pinhole(name)])))
        pose = [*_quaternion(name), *world_to_camera(name)[:, 3]]
        images.append(" ".join(map(str, [i + 1, *pose, i + 7, f"{name}.png"])))
        images.append("" if i else "10.5 11.5 -1 3.0 4.0 17")
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (folder / "images.txt").write_text("\n".join(images) + "\n")
    return folder


def colmap_binary(path: Path) -> Path:
    folder = path / "sparse" / "0"
    folder.mkdir(parents=True)
    cameras, images = struct.pack("<Q", len(CAMERAS)), struct.pack("<Q", len(CAMERAS))
    for i, name in enumerate(CAMERAS):
        cameras += struct.pack("<IiQQ4d", i + 7, COLMAP_MODELS["PINHOLE"], WIDTH, HEIGHT, *_pinhole(name))
        images += struct.pack("<I7dI", i + 1, *_quaternion(name), *world_to_camera(name)[:, 3], i + 7)
        images += f"{name}/0001.png".encode() + b"\0" + struct.pack("<Q", i) + struct.pack("<ddq", 1.0, 2.0, -1) * i
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)
    return folder


def opencv_matrix(name: str, value: np.ndarray) -> str:
    rows, columns = value.shape
    data = ", ".join(repr(float(v)) for v in value.ravel())
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {data} ]\n"


def _opencv_K(camera: str) -> np.ndarray:
    return intrinsics(camera) - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]


def easymocap(path: Path) -> Path:
    names = "names:\n" + "".join(f'   - "{name}"\n' for name in CAMERAS)
    intri, extri = "%YAML:1.0\n---\n" + names, "%YAML:1.0\n---\n" + names
    for name in CAMERAS:
        w2c = world_to_camera(name)
        intri += opencv_matrix(f"K_{name}", _opencv_K(name)) + opencv_matrix(f"dist_{name}", np.zeros((1, 5)))
        extri += opencv_matrix(f"R_{name}", Rotation.from_matrix(w2c[:, :3]).as_rotvec()[:, None])
        extri += opencv_matrix(f"Rot_{name}", w2c[:, :3]) + opencv_matrix(f"T_{name}", w2c[:, 3:])
    (path / "intri.yml").write_text(intri)
    (path / "extri.yml").write_text(extri)
    return path


def opencv_each(path: Path) -> Path:
    folder = path / "calibration"
    folder.mkdir()
    for name in CAMERAS:
        w2c = world_to_camera(name)
        text = f"%YAML:1.0\n---\nimage_width: {WIDTH}\nimage_height: {HEIGHT}\n"
        text += opencv_matrix("camera_matrix", _opencv_K(name))
        text += opencv_matrix("distortion_coefficients", np.zeros((5, 1)))
        text += opencv_matrix("rvec", Rotation.from_matrix(w2c[:, :3]).as_rotvec()[:, None])
        text += opencv_matrix("tvec", w2c[:, 3:])
        (folder / f"{name}.yml").write_text(text)
    return folder


CALIBRATIONS: dict[str, Callable[[Path], Path]] = {
    "json": json_calibration,
    "json_z_up": json_calibration_z_up,
    "colmap_text": colmap_text,
    "colmap_binary": colmap_binary,
    "easymocap": easymocap,
    "opencv_each": opencv_each,
}


# layouts


@dataclass(frozen=True)
class Written:
    """A recording on disk, and what must be said to import it."""

    path: Path
    takes: tuple[str, ...] = TAKES
    fps: float | None = None
    tests: tuple[str, ...] | None = None


def videos(root: Path, calibration: Callable[[Path], Path] = json_calibration) -> Written:
    for take in TAKES:
        for name in CAMERAS:
            write_video(root / "videos" / take / f"{name}.mp4", take_pictures(take, name))
    calibration(root)
    return Written(root)


def single_take_videos(root: Path) -> Written:
    for name in CAMERAS:
        write_video(root / "videos" / f"{name}.mp4", take_pictures("nod", name))
    easymocap(root)
    return Written(root, takes=("nod",))


def images(root: Path) -> Written:
    for take in TAKES:
        for name in CAMERAS:
            for frame, pixels in enumerate(take_pictures(take, name)):
                write_png(root / "images" / take / name / f"frame{frame + 8}.png", pixels)  # 10 comes after 9
    for name in CAMERAS:
        write_png(root / "background" / f"{name}.png", plate(name))
    json_calibration(root)
    return Written(root, fps=FPS)


def nersemble2(root: Path) -> Written:
    participant = root / "018"
    for take in TAKES:
        for name in CAMERAS:
            write_video(participant / "sequences" / take / "images" / f"cam_{name}.mp4", take_pictures(take, name))
    for name in CAMERAS:
        write_png(participant / "sequences" / "BACKGROUND" / f"image_{name}.png", plate(name))
    _write_camera_params(participant / "calibration" / "camera_params.json")
    write_json(participant / "calibration" / "color_calibration.json", {name: [] for name in CAMERAS})
    return Written(participant)


def nersemble1(root: Path) -> Written:
    for take in TAKES:
        for name in CAMERAS:
            write_video(root / "videos" / "018" / take / f"cam_{name}.mp4", take_pictures(take, name))
    _write_camera_params(root / "camera_params" / "018" / "camera_params.json")
    return Written(root / "videos" / "018")


def _write_camera_params(path: Path) -> None:
    to_file = np.diag([2200 / WIDTH, 3208 / HEIGHT, 1])
    poses = {name: np.r_[world_to_camera(name), [[0, 0, 0, 1]]].tolist() for name in CAMERAS}
    write_json(path, {"world_2_cam": poses, "intrinsics": (to_file @ shared_intrinsics()).tolist()})


def shared_intrinsics() -> np.ndarray:
    """NeRSemble has one K for all cameras."""
    return intrinsics(CAMERAS[0])


def hhavatar(root: Path) -> Written:
    for name in CAMERAS:
        write_npz_camera(root / "cameras" / f"camera_{name}.npz", name)
        for take in TAKES:
            write_video(root / "sequences" / take / "videos" / f"image_{name}.mp4", take_pictures(take, name))
    return Written(root)


def _vhap_frames(take: str, prefix: str, first: int) -> list[dict[str, Any]]:
    frames = []
    for frame in range(FRAMES):
        for name in CAMERAS:
            c2w = np.eye(4)
            w2c = world_to_camera(name)
            c2w[:3, :3], c2w[:3, 3] = w2c[:, :3].T, -w2c[:, :3].T @ w2c[:, 3]
            c2w = c2w @ np.diag([1.0, -1.0, -1.0, 1.0])  # to OpenGL's axes
            K, stem = intrinsics(name), f"{frame:05d}_{int(name):02d}"
            frames.append(
                {
                    "timestep_index": first + frame,
                    "camera_index": int(name),
                    "fl_x": K[0, 0],
                    "fl_y": K[1, 1],
                    "cx": K[0, 2],
                    "cy": K[1, 2],
                    "w": WIDTH,
                    "h": HEIGHT,
                    "transform_matrix": c2w.tolist(),
                    "file_path": f"{prefix}images/{stem}.png",
                    "fg_mask_path": f"{prefix}fg_masks/{stem}.png",
                }
            )
    return frames


def _write_vhap_images(folder: Path, take: str) -> None:
    for frame in range(FRAMES):
        for name in CAMERAS:
            stem = f"{frame:05d}_{int(name):02d}"
            write_png(folder / "images" / f"{stem}.png", picture(take, frame, name))
            write_png(folder / "fg_masks" / f"{stem}.png", mask(take, frame, name))


def vhap(root: Path) -> Written:
    _write_vhap_images(root / "nod", "nod")
    write_json(root / "nod" / "transforms.json", {"frames": _vhap_frames("nod", "", 0)})
    return Written(root / "nod", takes=("nod",), fps=FPS)


def vhap_combined(root: Path) -> Written:
    for take in TAKES:
        _write_vhap_images(root / take, take)
    train = _vhap_frames("nod", "../nod/", 0)
    for division, frames in {
        "train": [frame for frame in train if frame["camera_index"] == 1],
        "val": [frame for frame in train if frame["camera_index"] == 2],
        "test": _vhap_frames("FREE", "../FREE/", FRAMES),
    }.items():
        write_json(root / "UNION" / f"transforms_{division}.json", {"frames": frames})
    return Written(root / "UNION", fps=FPS, tests=("FREE",))


def capture(root: Path) -> Written:
    for t, take in enumerate(TAKES):
        for frame in range(FRAMES):
            number = f"{t * FRAMES + frame:04d}"
            for name in CAMERAS:
                write_png(root / "images" / number / f"image_{name}.png", picture(take, frame, name))
                write_png(root / "images" / number / f"mask_{name}.png", mask(take, frame, name))
                write_npz_camera(root / "cameras" / number / f"camera_{name}.npz", name)
    for name in CAMERAS:
        write_png(root / "static360" / "images" / f"image_ring{name}.png", picture("FREE", 2, name))
        write_npz_camera(root / "static360" / "cameras" / f"camera_ring{name}.npz", name)
    manifest = {
        "fps": FPS,
        "image_size": [WIDTH, HEIGHT],
        "gravity": [0, -9.5, 0],
        "background": [0, 0.5, 1],
        "cameras": {name: {"azimuth": i} for i, name in enumerate(CAMERAS)},
        "segments": [
            {"motion": "nod", "start": 0, "count": FRAMES, "split": "test"},
            {"motion": "FREE", "start": FRAMES, "count": FRAMES, "split": "train"},
        ],
        "static360": {"frame": FRAMES + 2},
    }
    write_json(root / "capture.json", manifest)
    return Written(root, tests=("nod",))


LAYOUTS: dict[str, Callable[[Path], Written]] = {
    "videos": videos,
    "single_take_videos": single_take_videos,
    "images": images,
    "nersemble2": nersemble2,
    "nersemble1": nersemble1,
    "hhavatar": hhavatar,
    "vhap": vhap,
    "vhap_combined": vhap_combined,
    "capture": capture,
}
