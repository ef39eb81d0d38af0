"""Calibration files: cameras by name, and the world that they stand in."""

from __future__ import annotations

from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.calibration.table import Calibration

__all__ = ["Calibration", "read_calibration"]

_STORAGE = (".yml", ".yaml", ".xml")
_PLACES = ("calibration.json", "sparse/0", "sparse", "calibration", "calibration.yml", "calibration.xml")


def read_calibration(path: Path | None, beside: Path) -> Calibration:
    """Read a calibration, whichever its format.

    Args:
        path: a JSON file of ours, a folder of COLMAP's text or binary files, OpenCV's YAML or XML, or a folder of
            those; None to look for one in ``beside``.
        beside: the recording's folder.

    Raises:
        DynhairError: there is none, or it is not sound.
    """
    path = path if path is not None else _find(beside)
    if not path.exists():
        raise DynhairError("the calibration is missing", path=path)
    if path.is_file() and path.suffix.lower() == ".json":
        from dynhair.preprocess.sources.calibration.json_file import read_json_calibration

        return read_json_calibration(path)
    if _is_colmap(path):
        from dynhair.preprocess.sources.calibration.colmap import read_colmap

        return read_colmap(path)
    files = [path] if path.is_file() else sorted(p for p in path.iterdir() if p.suffix.lower() in _STORAGE)
    if files and all(file.suffix.lower() in _STORAGE for file in files):
        from dynhair.preprocess.sources.calibration.opencv import read_opencv

        return read_opencv(path, files)
    raise DynhairError(
        "is not a calibration",
        path=path,
        expected="a .json, COLMAP's folder with cameras and images as .txt or .bin, or OpenCV's .yml, .yaml or .xml",
    )


def _find(beside: Path) -> Path:
    for place in _PLACES:
        path = beside / place
        if path.is_file() or _is_colmap(path) or (path.is_dir() and any(p.suffix in _STORAGE for p in path.iterdir())):
            return path
    if (beside / "intri.yml").is_file():
        return beside
    raise DynhairError(
        "no calibration is there",
        path=beside,
        expected=" or ".join([*_PLACES, "intri.yml with extri.yml"]),
        mend="give its path as the calibration",
    )


def _is_colmap(path: Path) -> bool:
    return any((path / f"images{suffix}").is_file() for suffix in (".bin", ".txt"))
