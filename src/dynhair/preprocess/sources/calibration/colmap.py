"""COLMAP's sparse models, text and binary; see colmap.github.io/format.html.

COLMAP's pixel centres are at (i + 0.5, j + 0.5) and its poses are world-to-camera, as everywhere here. It knows neither
scale nor up.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from scipy.spatial.transform import Rotation

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.calibration.table import Calibration
from dynhair.preprocess.sources.matrices import distortion, intrinsics, numbers, size
from dynhair.preprocess.sources.recording import SourceCamera

_SAME_POSE = 1e-6


@dataclass(frozen=True)
class _Model:
    """One of COLMAP's camera models.

    Attributes:
        number: as in binary files.
        one_focal: whether fx and fy are one parameter.
        coefficients: for each parameter of distortion its place in OpenCV's vector.
        fisheye: whether the vector is that of OpenCV's fisheye model.
    """

    number: int
    one_focal: bool
    coefficients: tuple[int, ...] = ()
    fisheye: bool = False

    @property
    def parameters(self) -> int:
        return (3 if self.one_focal else 4) + len(self.coefficients)


_MODELS = {
    "SIMPLE_PINHOLE": _Model(0, True),
    "PINHOLE": _Model(1, False),
    "SIMPLE_RADIAL": _Model(2, True, (0,)),
    "RADIAL": _Model(3, True, (0, 1)),
    "OPENCV": _Model(4, False, (0, 1, 2, 3)),
    "OPENCV_FISHEYE": _Model(5, False, (0, 1, 2, 3), fisheye=True),
    "FULL_OPENCV": _Model(6, False, (0, 1, 2, 3, 4, 5, 6, 7)),
    "SIMPLE_RADIAL_FISHEYE": _Model(8, True, (0,), fisheye=True),
    "RADIAL_FISHEYE": _Model(9, True, (0, 1), fisheye=True),
}


@dataclass(frozen=True)
class _Lens:
    K: np.ndarray
    distortion: np.ndarray
    fisheye: bool
    size: tuple[int, int]


@dataclass(frozen=True)
class _Image:
    name: str
    lens: int
    w2c: np.ndarray


def read_colmap(folder: Path) -> Calibration:
    """Read ``cameras`` and ``images``, binary if both are there.

    An image belongs to the camera that its name says: ``front.png``, or ``front/0001.png``.

    Raises:
        DynhairError: a file is missing, truncated or malformed, a camera's model is not supported, or images of one
            camera have different poses.
    """
    suffix = ".bin" if (folder / "images.bin").is_file() else ".txt"
    cameras, images = folder / f"cameras{suffix}", folder / f"images{suffix}"
    read_lenses, read_images = (_binary_lenses, _binary_images) if suffix == ".bin" else (_text_lenses, _text_images)
    lenses = dict(read_lenses(cameras))
    found: dict[str, SourceCamera] = {}
    for image in sorted(read_images(images), key=lambda image: image.name):
        if image.lens not in lenses:
            raise DynhairError(
                f"image `{image.name}`: `CAMERA_ID` is {image.lens}", path=images, expected=f"one that {cameras} has"
            )
        lens = lenses[image.lens]
        name = _camera_name(image.name)
        if name in found and np.abs(found[name].w2c - image.w2c).max() > _SAME_POSE:
            raise DynhairError(
                f"image `{image.name}`: camera `{name}` has another pose than in its first image",
                path=images,
                expected="cameras that stand still",
                mend="reconstruct from one image of each camera",
            )
        found.setdefault(name, SourceCamera(image.w2c, lens.K, lens.distortion, lens.fisheye, lens.size))
    return Calibration(folder, found)


def _camera_name(image: str) -> str:
    path = PurePosixPath(image)
    return path.parts[0] if len(path.parts) > 1 else path.stem


def _lens(model: str, width: int, height: int, values: list[float], path: Path, where: str) -> _Lens:
    kind = _MODELS[model]
    numbers(values, (kind.parameters,), path, f"{where}: PARAMS[] of {model}")
    focal, (cx, cy, *rest) = values[: (1 if kind.one_focal else 2)], values[(1 if kind.one_focal else 2) :]
    coefficients = np.zeros(8 if len(rest) > 4 else 4 if rest else 0)
    coefficients[list(kind.coefficients)] = rest
    K = [[focal[0], 0, cx], [0, focal[-1], cy], [0, 0, 1]]
    return _Lens(
        K=intrinsics(K, path, f"{where}: PARAMS[]"),
        distortion=distortion(coefficients, path, f"{where}: PARAMS[]", fisheye=kind.fisheye and bool(rest)),
        fisheye=kind.fisheye,
        size=size([width, height], path, f"{where}: WIDTH, HEIGHT"),
    )


def _image(name: str, lens: int, quaternion: list[float], translation: list[float], path: Path) -> _Image:
    q = numbers(quaternion, (4,), path, f"image {name}: QW, QX, QY, QZ")
    t = numbers(translation, (3,), path, f"image {name}: TX, TY, TZ")
    if abs(np.linalg.norm(q) - 1) > 1e-2:
        raise DynhairError(
            f"image `{name}`: `QW, QX, QY, QZ` has the length {np.linalg.norm(q):.3g}", path=path, expected="1"
        )
    return _Image(name, lens, np.c_[Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix(), t])


def _unknown_model(model: object, path: Path, where: str) -> DynhairError:
    return DynhairError(
        f"{where}: `MODEL` is {model}",
        path=path,
        expected=" or ".join(_MODELS),
        mend="undistort with COLMAP's image_undistorter, or calibrate with one of these models",
    )


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise DynhairError("the file is missing", path=path) from None
    except UnicodeDecodeError:
        raise DynhairError("is not text", path=path) from None
    return [line for line in text.splitlines() if not line.startswith("#")]


def _text_lenses(path: Path) -> Iterator[tuple[int, _Lens]]:
    for line in _lines(path):
        if not line.strip():
            continue
        with_model = line.split()
        where = f"camera {with_model[0]}"
        if len(with_model) > 1 and with_model[1] not in _MODELS:
            raise _unknown_model(with_model[1], path, where)
        try:
            number, model, width, height, *values = with_model
            yield int(number), _lens(model, int(width), int(height), [float(v) for v in values], path, where)
        except ValueError:
            raise DynhairError(
                f"{where}: the line is {line!r}", path=path, expected="CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"
            ) from None


def _text_images(path: Path) -> Iterator[_Image]:
    lines = _lines(path)
    while lines and not lines[-1].strip():
        lines.pop()
    for line in lines[::2]:  # every second line holds the points, and may be empty
        try:
            _, *pose, lens, name = line.split(maxsplit=9)
            values = [float(v) for v in pose]
            yield _image(name, int(lens), values[:4], values[4:], path)
        except ValueError:
            raise DynhairError(
                f"the line of an image is {line[:80]!r}",
                path=path,
                expected="IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME, then a line of points",
            ) from None


class _Reader:
    """Reads little-endian numbers, and says where a file ends too early."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._data = path.read_bytes()
        except FileNotFoundError:
            raise DynhairError("the file is missing", path=path) from None
        self._at = 0

    def numbers(self, layout: str, what: str) -> list:
        end = self._at + struct.calcsize("<" + layout)
        self._require(end, what)
        values = struct.unpack_from("<" + layout, self._data, self._at)
        self._at = end
        return list(values)

    def text(self, what: str) -> str:
        end = self._data.find(b"\0", self._at)
        self._require(end if end >= 0 else len(self._data) + 1, what)
        value = self._data[self._at : end].decode("utf-8", "replace")
        self._at = end + 1
        return value

    def skip(self, count: int, what: str) -> None:
        self._require(self._at + count, what)
        self._at += count

    def _require(self, end: int, what: str) -> None:
        if end > len(self._data):
            raise DynhairError(
                f"is truncated: it ends at byte {len(self._data)}, within {what}",
                path=self.path,
                expected="a whole file",
                mend="copy it again",
            )


def _binary_lenses(path: Path) -> Iterator[tuple[int, _Lens]]:
    names: dict[int, str] = {model.number: name for name, model in _MODELS.items()}
    reader = _Reader(path)
    (count,) = reader.numbers("Q", "the number of cameras")
    for i in range(count):
        number, model, width, height = reader.numbers("IiQQ", f"camera {i + 1} of {count}")
        where = f"camera {number}"
        if model not in names:
            raise _unknown_model(model, path, where)
        values = reader.numbers(f"{_MODELS[names[model]].parameters}d", f"the parameters of {where}")
        yield number, _lens(names[model], width, height, values, path, where)


def _binary_images(path: Path) -> Iterator[_Image]:
    reader = _Reader(path)
    (count,) = reader.numbers("Q", "the number of images")
    for i in range(count):
        what = f"image {i + 1} of {count}"
        _, *pose, lens = reader.numbers("I7dI", what)
        name = reader.text(what)
        (points,) = reader.numbers("Q", what)
        reader.skip(24 * points, f"the points of {what}")  # x, y as doubles and the index of a 3D point
        yield _image(name, lens, pose[:4], pose[4:], path)
