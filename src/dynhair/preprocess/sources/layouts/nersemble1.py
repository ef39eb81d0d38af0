"""A participant of NeRSemble's first version.

``ID/SEQUENCE/cam_SERIAL.mp4`` and, one or two folders further up, ``camera_params/ID/camera_params.json``.
"""

from __future__ import annotations

from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.layouts.nersemble2 import read_camera_params
from dynhair.preprocess.sources.layouts.videos import folders_in, video_take, videos_in
from dynhair.preprocess.sources.recording import Recording


def matches(path: Path) -> bool:
    """Whether a folder looks like it."""
    has_videos = any(videos_in(folder, "cam_") for folder in folders_in(path))
    return has_videos and any(place.is_file() for place in _places(path))


def open_nersemble1(path: Path, calibration: Path | None) -> Recording:
    """Open a participant's folder."""
    sequences = {folder.name: found for folder in folders_in(path) if (found := videos_in(folder, "cam_"))}
    if not sequences:
        raise DynhairError("no videos are there", path=path, expected="SEQUENCE/cam_SERIAL.mp4")
    table = read_camera_params(calibration or _camera_params(path))
    takes = tuple(video_take(name, videos, table) for name, videos in sequences.items())
    return Recording(
        path=path,
        layout="nersemble1",
        takes=takes,
        notes=table.notes(takes),
    )


def _camera_params(path: Path) -> Path:
    places = _places(path)
    for place in places:
        if place.is_file():
            return place
    raise DynhairError(
        "no camera_params.json is there",
        path=places[-1],
        expected="camera_params/ID/camera_params.json one or two folders above the participant's",
        mend="give its path as the calibration",
    )


def _places(path: Path) -> list[Path]:
    path = path.resolve()
    return [above / "camera_params" / path.name / "camera_params.json" for above in list(path.parents)[:2]]
