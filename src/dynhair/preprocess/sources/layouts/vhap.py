"""What VHAP exports for GaussianAvatars: ``transforms.json``, ``images/00000_00.png`` and ``fg_masks/00000_00.png``.

Several such folders combined have ``transforms_train.json``, ``transforms_val.json`` and ``transforms_test.json``
instead, whose frames come from the folders beside; each of those is a take.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynhair.capture.records import Split
from dynhair.errors import DynhairError
from dynhair.preprocess.sources.matrices import field, intrinsics, inverse, numbers, world_to_camera
from dynhair.preprocess.sources.pictures import PictureFrames
from dynhair.preprocess.sources.recording import Channel, Recording, SourceCamera, Take
from dynhair.storage import read_json

_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # x right, y up, z backward, as in NeRF's files
_SINGLE = "transforms.json"
_COMBINED: dict[str, Split] = {
    "transforms_train.json": "train",
    "transforms_val.json": "train",  # held-out cameras of the same takes
    "transforms_test.json": "test",
}


@dataclass(frozen=True)
class _View:
    take: Path
    split: Split | None
    time: int
    camera: str
    source: SourceCamera
    image: Path
    mask: Path | None


def matches(path: Path) -> bool:
    """Whether a folder looks like it."""
    return any((path / name).is_file() for name in (_SINGLE, *_COMBINED))


def open_vhap(path: Path, calibration: Path | None) -> Recording:
    """Open it. Its tracked head is not read: the head is tracked anew."""
    if calibration is not None:
        raise DynhairError("is not used: VHAP's folders bring their cameras", path=calibration)
    files: dict[str, Split | None] = {_SINGLE: None} if (path / _SINGLE).is_file() else {**_COMBINED}
    views = [view for name, split in files.items() if (path / name).is_file() for view in _views(path / name, split)]
    if not views:
        raise DynhairError("`frames` is empty", path=path / _SINGLE, expected="a list with frames")
    takes: dict[Path, list[_View]] = {}
    for view in views:
        takes.setdefault(view.take, []).append(view)
    return Recording(path=path, layout="vhap", takes=tuple(_take(folder, takes[folder]) for folder in sorted(takes)))


def _views(file: Path, split: Split | None) -> Iterator[_View]:
    raw = read_json(file)
    frames = field(raw, "frames", file)
    if not isinstance(frames, list):
        raise DynhairError("`frames` is not a list", path=file, expected="a list with frames")
    for i, frame in enumerate(frames):
        if not isinstance(frame, Mapping):
            raise DynhairError(f"`frames[{i}]` is not an object", path=file, expected="an object")
        yield _view({**raw, **frame}, file, f"frames[{i}]", split)


def _view(frame: Mapping[str, Any], file: Path, where: str, split: Split | None) -> _View:
    def number(key: str) -> float:
        return float(numbers(field(frame, key, file, where), (), file, f"{where}.{key}"))

    pose = world_to_camera(field(frame, "transform_matrix", file, where), file, f"{where}.transform_matrix")
    c2w = pose @ _FROM_OPENGL
    K = [[number("fl_x"), 0, number("cx")], [0, number("fl_y"), number("cy")], [0, 0, 1]]
    image = _beside(file, str(field(frame, "file_path", file, where)))
    mask = frame.get("fg_mask_path")
    return _View(
        take=image.parent.parent,
        split=split,
        time=int(number("timestep_index")),
        camera=f"{int(number('camera_index')):02d}",
        source=SourceCamera(
            w2c=inverse(c2w),
            K=intrinsics(K, file, f"{where}.fl_x fl_y cx cy"),
            size=(int(number("w")), int(number("h"))) if {"w", "h"} <= set(frame) else None,
        ),
        image=image,
        mask=None if mask is None else _beside(file, str(mask)),
    )


def _beside(file: Path, relative: str) -> Path:
    return Path(os.path.normpath(file.parent / relative))


def _take(folder: Path, views: list[_View]) -> Take:
    by_camera: dict[str, dict[int, _View]] = {}
    for view in views:
        by_camera.setdefault(view.camera, {})[view.time] = view
    times = sorted({view.time for view in views})
    channels: dict[str, Channel] = {}
    for camera in sorted(by_camera):
        for time in times:
            if time not in by_camera[camera]:
                raise DynhairError(
                    f"camera_index {int(camera)} has no frame of timestep_index {time}",
                    path=folder,
                    expected="every camera at every time step",
                    mend="export again, or leave the camera out of the file",
                )
        channels[camera] = _channel([by_camera[camera][time] for time in times])
    return Take(folder.resolve().name, channels, views[0].split)


def _channel(views: list[_View]) -> Channel:
    cameras = [view.source for view in views]
    moves = any(not (np.array_equal(c.w2c, cameras[0].w2c) and np.array_equal(c.K, cameras[0].K)) for c in cameras)
    masks = tuple(view.mask for view in views)
    return Channel(
        frames=PictureFrames(views[0].image.parent, tuple(view.image for view in views)),
        camera=cameras.__getitem__ if moves else lambda _: cameras[0],
        masks={"mask": masks} if any(masks) else {},
    )
