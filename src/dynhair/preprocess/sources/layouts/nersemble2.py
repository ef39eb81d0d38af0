"""A participant of NeRSemble's second version.

``calibration/camera_params.json``, ``sequences/SEQUENCE/images/cam_SERIAL.mp4`` and
``sequences/BACKGROUND/image_SERIAL.jpg``. ``color_calibration.json`` is not applied: its matrices are for linear light
and a polynomial of the colours, and what matters here is that a camera agrees with itself over time.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.calibration import Calibration
from dynhair.preprocess.sources.layouts.videos import folders_in, plates, video_take, videos_in
from dynhair.preprocess.sources.matrices import field, intrinsics, size, world_to_camera
from dynhair.preprocess.sources.recording import Recording, SourceCamera
from dynhair.storage import read_json

_CALIBRATED_SIZE = (2200, 3208)  # the dataset's portraits


def matches(path: Path) -> bool:
    """Whether a folder looks like it."""
    return (path / "calibration" / "camera_params.json").is_file() and (path / "sequences").is_dir()


def open_nersemble2(path: Path, calibration: Path | None) -> Recording:
    """Open a participant's folder."""
    folders = {folder.name: videos_in(folder / "images", "cam_") for folder in folders_in(path / "sequences")}
    sequences = {name: videos for name, videos in folders.items() if videos}
    if not sequences:
        raise DynhairError("no videos are there", path=path / "sequences", expected="SEQUENCE/images/cam_SERIAL.mp4")
    table = read_camera_params(calibration or path / "calibration" / "camera_params.json")
    takes = tuple(video_take(name, videos, table) for name, videos in sequences.items())
    return Recording(
        path=path,
        layout="nersemble2",
        takes=takes,
        notes=table.notes(takes),
        plates=plates(path / "sequences" / "BACKGROUND", "image_"),
    )


def read_camera_params(path: Path) -> Calibration:
    """Read ``camera_params.json``: one K for all cameras, and a world-to-camera matrix for each."""
    raw = read_json(path)
    K = intrinsics(field(raw, "intrinsics", path), path, "intrinsics")
    poses = field(raw, "world_2_cam", path)
    if not isinstance(poses, Mapping):
        raise DynhairError("`world_2_cam` is not an object", path=path, expected="a matrix for each camera")
    calibrated = _CALIBRATED_SIZE
    if {"width", "height"} <= set(raw):
        calibrated = size([raw["width"], raw["height"]], path, "width, height")
    return Calibration(
        path,
        {
            name: SourceCamera(world_to_camera(pose, path, f"world_2_cam.{name}"), K, size=calibrated)
            for name, pose in poses.items()
        },
    )
