"""Layouts of recordings, and which one a folder has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

from dynhair.errors import DynhairError
from dynhair.preprocess.options import LayoutName
from dynhair.preprocess.sources.layouts import capture, hhavatar, images, nersemble1, nersemble2, vhap, videos
from dynhair.preprocess.sources.recording import Recording

_Opener = Callable[[Path, "Path | None"], Recording]
_LAYOUTS: dict[LayoutName, tuple[Callable[[Path], bool], _Opener]] = {
    "nersemble2": (nersemble2.matches, nersemble2.open_nersemble2),
    "nersemble1": (nersemble1.matches, nersemble1.open_nersemble1),
    "hhavatar": (hhavatar.matches, hhavatar.open_hhavatar),
    "vhap": (vhap.matches, vhap.open_vhap),
    "capture": (capture.matches, capture.open_capture),
    "videos": (videos.matches, videos.open_videos),
    "images": (images.matches, images.open_images),
}


def open_recording(
    path: Path | str,
    layout: LayoutName | Literal["auto"] = "auto",
    calibration: Path | None = None,
    fps: float | None = None,
) -> Recording:
    """Find what a folder of raw material holds; pictures are not read yet.

    Args:
        path: the recording's folder.
        layout: how it is laid out; ``auto`` tells by its files.
        calibration: the cameras, where they are not at their layout's usual place.
        fps: frames per second, in the place of what the recording says.

    Raises:
        DynhairError: there is no such recording, or its cameras are not sound.
    """
    path = Path(path)
    if not path.is_dir():
        raise DynhairError("the folder is missing" if not path.exists() else "is not a folder", path=path)
    if fps is not None and not 0 < fps <= 1000:
        raise DynhairError(f"`fps` is {fps}", expected="frames per second, a number above 0")
    found = _guess(path) if layout == "auto" else layout
    if found is None:
        raise DynhairError(
            "holds no recording of a known layout",
            path=path,
            expected=" or ".join(_LAYOUTS),
            mend="see docs/preprocess_inputs.md; videos/NAME.mp4 with a calibration.json is the simplest",
        )
    recording = _LAYOUTS[found][1](path, calibration)
    return recording if fps is None else replace(recording, fps=fps)


def _guess(path: Path) -> LayoutName | None:
    return next((name for name, (matches, _) in _LAYOUTS.items() if matches(path)), None)
