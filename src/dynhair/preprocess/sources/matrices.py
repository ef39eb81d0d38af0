"""Checked numbers of cameras: whatever a calibration file holds, or an error that names the file and the field."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from dynhair.errors import DynhairError

ROTATION_TOLERANCE = 1e-3
"""By which R R^T may differ from the identity: files round to few digits."""

_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)  # of OpenCV's model


def field(raw: Mapping[str, Any], key: str, path: Path, where: str = "") -> Any:
    """Return ``raw[key]``.

    Args:
        raw: an object of the file.
        key: the field.
        path: the file.
        where: the object's name in the file, such as ``cameras.front``; empty for the whole file.

    Raises:
        DynhairError: it is not there.
    """
    if key not in raw:
        raise DynhairError(f"`{named(where, key)}` is missing", path=path, expected=f"a field `{key}`")
    return raw[key]


def named(where: str, key: str) -> str:
    """Join the names of an object and of a field in it."""
    return f"{where}.{key}" if where else key


def numbers(value: Any, shape: tuple[int | None, ...], path: Path, name: str) -> np.ndarray:
    """Read an array of finite numbers.

    Args:
        value: nested lists or an array.
        shape: None stands for any length.
        path: the file.
        name: the field.

    Raises:
        DynhairError: not numbers, not of this shape, or not finite.
    """
    wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise DynhairError(f"`{name}` is not an array of numbers", path=path, expected=f"shape {wanted}") from None
    fits = array.ndim == len(shape) and all(n in (None, length) for n, length in zip(shape, array.shape, strict=True))
    if not fits:
        raise DynhairError(f"`{name}` has the shape {array.shape}", path=path, expected=wanted)
    if not np.isfinite(array).all():
        raise DynhairError(f"`{name}` holds NaN or infinity", path=path, expected="finite numbers")
    return array


def intrinsics(value: Any, path: Path, name: str) -> Float64[np.ndarray, "3 3"]:
    """Read a calibration matrix without skew.

    Raises:
        DynhairError: not ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``.
    """
    K = numbers(value, (3, 3), path, name)
    off_diagonal = np.abs([K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1]).max()
    if min(K[0, 0], K[1, 1]) <= 0 or off_diagonal > 1e-6 * max(K[0, 0], 1):
        raise DynhairError(
            f"`{name}` is {np.array2string(K, precision=4).replace(chr(10), '')}",
            path=path,
            expected="[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, without skew",
            mend="calibrate again without skew",
        )
    return K


def world_to_camera(value: Any, path: Path, name: str) -> Float64[np.ndarray, "3 4"]:
    """Read ``[R | t]`` from a matrix of 3 or 4 rows.

    Raises:
        DynhairError: another shape, R is not a rotation, or the fourth row is not 0 0 0 1.
    """
    rows = numbers(value, (None, 4), path, name)
    if len(rows) not in (3, 4):
        raise DynhairError(f"`{name}` has the shape {rows.shape}", path=path, expected="(3, 4) or (4, 4)")
    if len(rows) == 4 and np.abs(rows[3] - [0, 0, 0, 1]).max() > 1e-6:
        raise DynhairError(
            f"the fourth row of `{name}` is {rows[3].tolist()}",
            path=path,
            expected="0 0 0 1",
            mend="transpose the matrix if its translation is in that row",
        )
    rotation(rows[:3, :3], path, name)
    return rows[:3]


def rotation(value: Any, path: Path, name: str) -> Float64[np.ndarray, "3 3"]:
    """Read a rotation matrix.

    Raises:
        DynhairError: not orthonormal, or a reflection.
    """
    R = numbers(value, (3, 3), path, name)
    error = float(np.abs(R @ R.T - np.eye(3)).max())
    if error > ROTATION_TOLERANCE:
        raise DynhairError(
            f"the rotation in `{name}` is not orthonormal (off by {error:.3g})",
            path=path,
            expected="a rotation matrix",
            mend="divide a scale out of it; scale the world by metres_per_unit",
        )
    if np.linalg.det(R) < 0:
        raise DynhairError(
            f"the rotation in `{name}` is a reflection (determinant -1)",
            path=path,
            expected="a right-handed rotation, determinant +1",
            mend="flip one axis of the world or of the camera: OpenCV's are x right, y down, z forward",
        )
    return R


def inverse(pose: Float64[np.ndarray, "3 4"]) -> Float64[np.ndarray, "3 4"]:
    """Invert ``[R | t]``: camera-to-world to world-to-camera, or back."""
    R = pose[:, :3]
    return np.c_[R.T, -R.T @ pose[:, 3]]


def distortion(value: Any, path: Path, name: str, *, fisheye: bool = False) -> Float64[np.ndarray, " n"]:
    """Read distortion coefficients in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 ..., or k1 k2 k3 k4 of a fisheye.

    Raises:
        DynhairError: their number is not one that OpenCV's model has.
    """
    coefficients = numbers(np.ravel(value) if isinstance(value, np.ndarray) else value, (None,), path, name)
    lengths = (4,) if fisheye else _DISTORTION_LENGTHS
    if len(coefficients) not in lengths:
        raise DynhairError(
            f"`{name}` has {len(coefficients)} coefficients",
            path=path,
            expected=" or ".join(map(str, lengths)) + ": " + ("k1 k2 k3 k4" if fisheye else "k1 k2 p1 p2 k3 k4 k5 k6"),
            mend="fill up with zeros",
        )
    return coefficients


def size(value: Any, path: Path, name: str) -> tuple[int, int]:
    """Read a width and a height in pixels."""
    width, height = numbers(value, (2,), path, name)
    if min(width, height) < 1 or width % 1 or height % 1:
        raise DynhairError(f"`{name}` is {width:g} x {height:g}", path=path, expected="width and height in pixels")
    return int(width), int(height)
