"""``videos/CAMERA.mp4``, or ``videos/TAKE/CAMERA.mp4``, and a calibration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.calibration import Calibration, read_calibration
from dynhair.preprocess.sources.pictures import EXTENSIONS as PICTURES
from dynhair.preprocess.sources.pictures import natural_key
from dynhair.preprocess.sources.recording import Channel, Recording, Take
from dynhair.preprocess.sources.video import EXTENSIONS, VideoFrames


def matches(path: Path) -> bool:
    """Whether a folder looks like it."""
    return bool(_takes(path / "videos"))


def open_videos(path: Path, calibration: Path | None) -> Recording:
    """Open it; ``background/CAMERA.png`` are clean plates."""
    named = _takes(path / "videos")
    if not named:
        raise DynhairError("no videos are there", path=path / "videos", expected="CAMERA.mp4, or TAKE/CAMERA.mp4")
    table = read_calibration(calibration, path)
    takes = tuple(video_take(name, files, table) for name, files in named.items())
    return Recording(
        path=path,
        layout="videos",
        takes=takes,
        notes=table.notes(takes),
        world=table.world,
        plates=plates(path / "background"),
    )


def video_take(name: str, videos: Mapping[str, Path], calibration: Calibration) -> Take:
    """Make a take of one video for each camera."""
    channels = {camera: Channel(VideoFrames(file), calibration.fixed(camera)) for camera, file in videos.items()}
    return Take(name, channels)


def videos_in(folder: Path, prefix: str = "") -> dict[str, Path]:
    """List the videos ``PREFIX CAMERA.mp4`` of a folder by camera."""
    return {
        file.stem.removeprefix(prefix): file
        for file in _sorted(folder)
        if file.suffix.lower() in EXTENSIONS and file.stem.startswith(prefix)
    }


def plates(folder: Path, prefix: str = "") -> dict[str, Path]:
    """List the pictures ``PREFIX CAMERA.png`` of a folder by camera."""
    return {
        file.stem.removeprefix(prefix): file
        for file in _sorted(folder)
        if file.suffix.lower() in PICTURES and file.stem.startswith(prefix)
    }


def folders_in(folder: Path) -> list[Path]:
    """List the folders in a folder, ``2`` before ``10``; none if it does not exist."""
    return [entry for entry in _sorted(folder) if entry.is_dir() and not entry.name.startswith(".")]


def _sorted(folder: Path) -> Iterable[Path]:
    return sorted(folder.iterdir(), key=natural_key) if folder.is_dir() else []


def _takes(folder: Path) -> dict[str, dict[str, Path]]:
    if single := videos_in(folder):
        return {"take": single}
    return {take.name: found for take in folders_in(folder) if (found := videos_in(take))}
