"""OpenCV's YAML and XML storage: one file for each camera, or one or two for all, as EasyMocap writes them.

OpenCV's pixel centres are at whole numbers, so half a pixel is added to the principal point.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.calibration.table import Calibration
from dynhair.preprocess.sources.matrices import distortion, intrinsics, numbers, rotation, size
from dynhair.preprocess.sources.recording import SourceCamera

# names that OpenCV's samples, EasyMocap and common calibration tools write; the first is for messages
_K = ("K", "camera_matrix", "cameraMatrix", "Camera_Matrix", "M")
_DISTORTION = ("dist", "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "distortion", "D")
_ROTATION = ("Rot", "R", "rotation", "rvec")
_TRANSLATION = ("T", "t", "tvec", "translation")
_WIDTH = ("W", "image_width", "image_Width", "width")
_HEIGHT = ("H", "image_height", "image_Height", "height")


def read_opencv(path: Path, files: Sequence[Path]) -> Calibration:
    """Read the cameras.

    One file has all, in fields such as ``K_NAME``, ``dist_NAME``, ``Rot_NAME`` and ``T_NAME``; or ``intri.yml`` and
    ``extri.yml`` share those; or there is a file ``NAME.yml`` for each camera.

    Args:
        path: the file or folder.
        files: the file, or the folder's.

    Raises:
        DynhairError: a file cannot be read, or a field is missing or not sound.
    """
    loaded = [_Storage(file) for file in files]
    if names := dict.fromkeys(name for storage in loaded for name in storage.names):
        return Calibration(path, {name: _camera(loaded, f"_{name}") for name in names})
    return Calibration(path, {storage.path.stem: _camera([storage], "") for storage in loaded})


class _Storage:
    """The matrices and numbers of a file, by the name of their node."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.nodes = dict(_read_nodes(path))

    @property
    def names(self) -> list[str]:
        """The cameras whose matrix is in it by name; none in a file of one camera."""
        prefixes = tuple(f"{key}_" for key in _K)
        return [node.removeprefix(prefix) for node in self.nodes for prefix in prefixes if node.startswith(prefix)]


def _camera(files: Sequence[_Storage], suffix: str) -> SourceCamera:
    K_file, K_name, K = _find(files, _K, suffix)
    R_file, R_name, R = _find(files, _ROTATION, suffix)
    t_file, t_name, t = _find(files, _TRANSLATION, suffix)
    centred = intrinsics(K, K_file, K_name)
    centred[:2, 2] += 0.5
    if np.size(R) == 3:
        R = Rotation.from_rotvec(numbers(np.ravel(R), (3,), R_file, R_name)).as_matrix()
    t = numbers(np.ravel(t), (3,), t_file, t_name)
    return SourceCamera(
        w2c=np.c_[rotation(R, R_file, R_name), t],
        K=centred,
        distortion=_distortion(files, suffix),
        size=_size(files, suffix),
    )


def _distortion(files: Sequence[_Storage], suffix: str) -> np.ndarray:
    path, name, value = _find(files, _DISTORTION, suffix)
    return distortion(np.asarray(value), path, name)


def _size(files: Sequence[_Storage], suffix: str) -> tuple[int, int] | None:
    try:
        path, name, width = _find(files, _WIDTH, suffix)
        _, _, height = _find(files, _HEIGHT, suffix)
    except DynhairError:
        return None
    return size([width, height], path, name)


def _find(files: Sequence[_Storage], keys: Sequence[str], suffix: str) -> tuple[Path, str, np.ndarray | float]:
    """The file, the name and the value of the first of several spellings of a field."""
    for storage in files:
        for key in keys:
            if key + suffix in storage.nodes:
                return storage.path, key + suffix, storage.nodes[key + suffix]
    raise DynhairError(
        f"`{keys[0]}{suffix}` is missing",
        path=files[-1].path,
        expected=" or ".join(key + suffix for key in keys),
    )


def _read_nodes(path: Path) -> Iterator[tuple[str, np.ndarray | float]]:
    import cv2

    with _readable(path):
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    try:
        for name in storage.root().keys():  # noqa: SIM118 (a node is not a mapping)
            node = storage.getNode(name)
            with _readable(path, name):
                if node.isMap():
                    yield name, node.mat()
                elif node.isReal() or node.isInt():
                    yield name, node.real()
                elif node.isSeq() and node.size() and (node.at(0).isReal() or node.at(0).isInt()):
                    yield name, np.array([node.at(i).real() for i in range(node.size())])
    finally:
        storage.release()


@contextmanager
def _readable(path: Path, node: str | None = None) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # OpenCV raises its own error, or SystemError around it
        what = "cannot be read" if node is None else f"`{node}` cannot be read"
        cause = error.__cause__ or error
        raise DynhairError(
            f"{what} ({getattr(cause, 'err', cause)})",
            path=path,
            expected="YAML or XML as cv2.FileStorage writes it, beginning with %YAML:1.0 or <?xml",
        ) from None
