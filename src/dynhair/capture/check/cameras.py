"""Checks of one camera: its matrices, and whether it sees the head."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dynhair.capture.arrays import read_npz
from dynhair.capture.check.findings import Finding

_ROTATION_TOLERANCE = 1e-3
_FOCAL_RANGE = (0.3, 20.0)  # in image widths: from 118 degrees to 3
_MIN_IN_IMAGE = 0.5  # of the landmarks: strong close-ups may cut some off


class CameraFile:
    """A camera as it stands in its file, not yet trusted.

    Args:
        path: the file.
        size: width and height of the images.

    Raises:
        DynhairError: the file cannot be read.
    """

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        arrays = read_npz(path, {"extrinsic": (3, 4), "intrinsic": (3, 3)})
        self.w2c = arrays["extrinsic"].astype(np.float64)
        self.K = arrays["intrinsic"].astype(np.float64)
        self.size = size

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (N, 2) and depths (N,) of world points (N, 3)."""
        return _project(self.w2c, self.K, points)

    def faults(self, file: Path) -> Iterator[Finding]:
        """Yield what is wrong with the matrices."""
        rotation = self.w2c[:, :3]
        error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if error > _ROTATION_TOLERANCE:
            yield Finding(
                "error",
                file,
                f"the rotation in `extrinsic` is not orthonormal (off by {error:.3g})",
                "[R | t] with R a rotation, t in metres",
                "divide a scale out of R, and write world-to-camera matrices",
            )
        elif np.linalg.det(rotation) < 0:
            yield Finding(
                "error",
                file,
                "the rotation in `extrinsic` is a reflection (determinant -1)",
                "a right-handed rotation, determinant +1",
                "flip one axis of the world or of the camera: OpenCV's are x right, y down, z forward",
            )
        yield from self._intrinsic_faults(file)

    def _intrinsic_faults(self, file: Path) -> Iterator[Finding]:
        K, (width, height) = self.K, self.size
        fx, fy = K[0, 0], K[1, 1]
        off_diagonal = np.abs([K[0, 1], K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1]).max()
        if off_diagonal > 1e-6 * max(abs(fx), 1):
            yield Finding(
                "error",
                file,
                f"`intrinsic` is {np.array2string(K, precision=4).replace(chr(10), '')}",
                "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, without skew",
                "undistort and resample the images to such a camera",
            )
        elif not (_FOCAL_RANGE[0] * width < fx < _FOCAL_RANGE[1] * width and 0.5 * fx < fy < 2 * fx):
            yield Finding(
                "error",
                file,
                f"focal lengths of {fx:.6g} and {fy:.6g} px for images of {width} x {height}",
                f"{_FOCAL_RANGE[0]:g} to {_FOCAL_RANGE[1]:g} image widths, in pixels",
                "scale K with the images",
            )
        elif not (0 < K[0, 2] < width and 0 < K[1, 2] < height):
            yield Finding(
                "warning",
                file,
                f"the principal point ({K[0, 2]:.6g}, {K[1, 2]:.6g}) is outside the image of {width} x {height}",
                "near the image's centre, unless it is a crop",
                "scale and crop K with the images",
            )

    def head_faults(self, file: Path, head: np.ndarray) -> Iterator[Finding]:
        """Yield a finding if points of the head (N, 3) are not before the camera and in the image."""
        pixels, depth = self.project(head)
        share = self._share_seen(pixels, depth)
        if share >= _MIN_IN_IMAGE:
            return
        swapped = self._share_seen(*_project(_inverse(self.w2c), self.K, head))
        if swapped >= 0.9:
            yield Finding(
                "error",
                file,
                "`extrinsic` is a camera-to-world matrix",
                "world-to-camera: x_camera = R x_world + t",
                "invert it: [R^T | -R^T t]",
            )
        elif (depth <= 0).mean() > 0.5:
            yield Finding(
                "error",
                file,
                "the head is behind the camera",
                "OpenCV axes: x right, y down, z forward",
                "negate the second and third row of `extrinsic` if its axes are OpenGL's",
            )
        else:
            yield Finding(
                "error",
                file,
                f"{1 - share:.0%} of the head's points are outside the image",
                "the head in the image, in the same units (metres) and world as the cameras",
                "mend the camera, or the pose and the landmarks of this frame",
            )

    def _share_seen(self, pixels: np.ndarray, depth: np.ndarray) -> float:
        return float(((depth > 0) & (pixels >= 0).all(-1) & (pixels < self.size).all(-1)).mean())


def _project(w2c: np.ndarray, K: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    local = points @ w2c[:, :3].T + w2c[:, 3]
    depth = local[:, 2]
    safe = np.where(np.abs(depth) > 1e-9, depth, 1e-9)
    return (local @ K.T)[:, :2] / safe[:, None], depth


def _inverse(w2c: np.ndarray) -> np.ndarray:
    rotation = w2c[:, :3].T
    return np.c_[rotation, -rotation @ w2c[:, 3]]
