"""The project's own calibration file, described in docs/preprocess_inputs.md."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np

from dynhair.errors import DynhairError
from dynhair.preprocess.options import Up
from dynhair.preprocess.sources.calibration.table import Calibration
from dynhair.preprocess.sources.matrices import (
    distortion,
    field,
    intrinsics,
    inverse,
    named,
    numbers,
    size,
    world_to_camera,
)
from dynhair.preprocess.sources.recording import SourceCamera, World
from dynhair.storage import read_json

VERSION = 1
_FOCAL = ("fx", "fy", "cx", "cy")
_TOP = {"version", "metres_per_unit", "up", "cameras", "notes"}
_CAMERA = {"size", "K", *_FOCAL, "model", "distortion", "world_to_camera", "camera_to_world", "notes"}


def read_json_calibration(path: Path) -> Calibration:
    """Read it.

    Raises:
        DynhairError: naming the field that is missing, unknown or not sound.
    """
    raw = read_json(path)
    _refuse_unknown(raw, _TOP, path, "")
    if raw.get("version", VERSION) != VERSION:
        raise DynhairError(f"`version` is {raw['version']!r}", path=path, expected=f"{VERSION}")
    cameras = field(raw, "cameras", path)
    if not isinstance(cameras, Mapping) or not cameras:
        raise DynhairError("`cameras` is not an object with cameras", path=path, expected='{"front": {...}, ...}')
    found = {name: _camera(value, path, f"cameras.{name}") for name, value in cameras.items()}
    return Calibration(path, found, _world(raw, path))


def _world(raw: Mapping[str, Any], path: Path) -> World:
    metres, up = float(numbers(raw.get("metres_per_unit", 1.0), (), path, "metres_per_unit")), raw.get("up", "y")
    if metres <= 0:
        raise DynhairError(f"`metres_per_unit` is {metres:g}", path=path, expected="a number above 0")
    if up not in get_args(Up):
        raise DynhairError(f"`up` is {up!r}", path=path, expected=" or ".join(get_args(Up)))
    return World(metres, up)


def _camera(raw: Any, path: Path, where: str) -> SourceCamera:
    if not isinstance(raw, Mapping):
        raise DynhairError(f"`{where}` is not an object", path=path, expected="an object with K and world_to_camera")
    _refuse_unknown(raw, _CAMERA, path, where)
    model = raw.get("model", "pinhole")
    if model not in ("pinhole", "fisheye"):
        raise DynhairError(f"`{where}.model` is {model!r}", path=path, expected="pinhole or fisheye")
    fisheye = model == "fisheye"
    coefficients = raw.get("distortion", [0.0] * 4 if fisheye else [])
    return SourceCamera(
        w2c=_pose(raw, path, where),
        K=_intrinsics(raw, path, where),
        distortion=distortion(coefficients, path, named(where, "distortion"), fisheye=fisheye),
        fisheye=fisheye,
        size=size(raw["size"], path, named(where, "size")) if "size" in raw else None,
    )


def _pose(raw: Mapping[str, Any], path: Path, where: str) -> np.ndarray:
    if ("world_to_camera" in raw) == ("camera_to_world" in raw):
        raise DynhairError(
            f"`{where}` has {'both' if 'world_to_camera' in raw else 'none'} of world_to_camera and camera_to_world",
            path=path,
            expected="one of them",
        )
    if "world_to_camera" in raw:
        return world_to_camera(raw["world_to_camera"], path, named(where, "world_to_camera"))
    return inverse(world_to_camera(raw["camera_to_world"], path, named(where, "camera_to_world")))


def _intrinsics(raw: Mapping[str, Any], path: Path, where: str) -> np.ndarray:
    if "K" in raw:
        if present := [key for key in _FOCAL if key in raw]:
            raise DynhairError(f"`{where}` has both K and {present[0]}", path=path, expected="K, or fx, fy, cx and cy")
        return intrinsics(raw["K"], path, named(where, "K"))
    fx, fy, cx, cy = (numbers(field(raw, key, path, where), (), path, named(where, key)) for key in _FOCAL)
    return intrinsics([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], path, f"{where}.fx fy cx cy")


def _refuse_unknown(raw: Mapping[str, Any], known: set[str], path: Path, where: str) -> None:
    if unknown := sorted(set(raw) - known):  # a misspelt `distortion` would be no distortion
        raise DynhairError(
            f"`{named(where, unknown[0])}` is not a field",
            path=path,
            expected=" or ".join(sorted(known)),
            mend="put words of your own under `notes`",
        )
