"""A subject of HHAvatar's recordings: ``cameras/camera_ID.npz`` and ``sequences/SEQUENCE/videos/image_ID.mp4``."""

from __future__ import annotations

from pathlib import Path

from dynhair.capture.arrays import read_npz
from dynhair.errors import DynhairError
from dynhair.preprocess.sources.calibration import Calibration
from dynhair.preprocess.sources.layouts.videos import folders_in, video_take, videos_in
from dynhair.preprocess.sources.matrices import intrinsics, world_to_camera
from dynhair.preprocess.sources.recording import Recording, SourceCamera

_PREFIX = "camera_"


def matches(path: Path) -> bool:
    """Whether a folder looks like it."""
    return any((path / "cameras").glob(f"{_PREFIX}*.npz")) and (path / "sequences").is_dir()


def open_hhavatar(path: Path, calibration: Path | None) -> Recording:
    """Open a subject's folder; ``calibration`` is another folder of cameras."""
    folders = {folder.name: videos_in(folder / "videos", "image_") for folder in folders_in(path / "sequences")}
    sequences = {name: videos for name, videos in folders.items() if videos}
    if not sequences:
        raise DynhairError("no videos are there", path=path / "sequences", expected="SEQUENCE/videos/image_ID.mp4")
    folder = calibration or path / "cameras"
    cameras = {file.stem.removeprefix(_PREFIX): read_camera(file) for file in sorted(folder.glob(f"{_PREFIX}*.npz"))}
    table = Calibration(folder, cameras)
    takes = tuple(video_take(name, videos, table) for name, videos in sequences.items())
    return Recording(
        path=path,
        layout="hhavatar",
        takes=takes,
        notes=table.notes(takes),
    )


def read_camera(path: Path) -> SourceCamera:
    """Read an ``.npz`` with ``extrinsic``, world-to-camera, and ``intrinsic``, as Gaussian Head Avatar has them."""
    arrays = read_npz(path, {"extrinsic": (None, 4), "intrinsic": (3, 3)})
    return SourceCamera(
        w2c=world_to_camera(arrays["extrinsic"], path, "extrinsic"),
        K=intrinsics(arrays["intrinsic"], path, "intrinsic"),
    )
