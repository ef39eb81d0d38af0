"""A prepared capture, or a folder of Gaussian Head Avatar's, taken as raw material: its pictures, cameras and masks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dynhair.capture.layout import DEFAULT_FPS, Layout, guess_manifest, view_names
from dynhair.capture.manifest import parse_manifest
from dynhair.capture.records import Segment
from dynhair.errors import DynhairError
from dynhair.preprocess.sources.layouts.hhavatar import read_camera
from dynhair.preprocess.sources.layouts.videos import plates
from dynhair.preprocess.sources.pictures import PictureFrames
from dynhair.preprocess.sources.recording import Channel, Recording, SourceCamera, StaticRing, Take
from dynhair.storage import read_json

_MASKS = ("mask", "hair")


def matches(path: Path) -> bool:
    """Whether a folder looks like it."""
    return any((path / "images").glob("[0-9]*/image_*")) and (path / "cameras").is_dir()


def open_capture(path: Path, calibration: Path | None) -> Recording:
    """Open it; each segment is a take with its split, and the masks it has are given.

    Raises:
        DynhairError: a picture or a camera of a frame is missing, or the manifest is not sound.
    """
    if calibration is not None:
        raise DynhairError("is not used: captures bring their cameras", path=calibration)
    layout = Layout(path)
    has_manifest = layout.manifest.exists()
    manifest = parse_manifest(read_json(layout.manifest), layout.manifest) if has_manifest else guess_manifest(layout)
    takes = tuple(
        Take(
            segment.name,
            {name: _channel(layout, segment, name) for name in manifest.camera_names},
            segment.split,
        )
        for segment in manifest.segments
    )
    notes = manifest.notes or {}
    return Recording(
        path=path,
        layout="capture",
        takes=takes,
        fps=manifest.fps,
        plates=plates(path / "background", "image_"),
        static=_static(layout, manifest.segments, manifest.static_frame),
        gravity=manifest.gravity,
        background=manifest.background,
        camera_notes=cameras if isinstance(cameras := notes.get("cameras"), dict) else {},
        notes=() if has_manifest else (f"{path} has no capture.json: taken to be {DEFAULT_FPS:g} frames a second",),
    )


def _channel(layout: Layout, segment: Segment, name: str) -> Channel:
    folders = [layout.frame_images(frame) for frame in segment.frames]
    return Channel(
        frames=PictureFrames(layout.images, tuple(_image(layout, folder, name) for folder in folders)),
        camera=_cameras([layout.camera(frame, name) for frame in segment.frames]),
        masks=_masks(layout, folders, name),
    )


def _static(layout: Layout, segments: tuple[Segment, ...], frame: int | None) -> StaticRing | None:
    names = sorted(view_names(layout.static_images))
    frame = segments[0].start if frame is None else frame
    segment = next((s for s in segments if frame in s.frames), None)
    if not names or segment is None:
        return None
    folder = layout.static_images
    channels = {
        name: Channel(
            frames=PictureFrames(folder, (_image(layout, folder, name),)),
            camera=_cameras([layout.static_camera(name)]),
            masks=_masks(layout, [folder], name),
        )
        for name in names
    }
    return StaticRing(channels, segment.name, frame - segment.start)


def _image(layout: Layout, folder: Path, name: str) -> Path:
    path = layout.find_image(folder, "image", name)
    if path is None:
        raise DynhairError(
            "the picture is missing",
            path=folder / f"image_{name}.jpg",
            expected="a .jpg or .png for every camera of every frame",
            mend="add it, or leave its frame out of the segments",
        )
    return path


def _masks(layout: Layout, folders: list[Path], name: str) -> dict[str, tuple[Path | None, ...]]:
    found = {kind: tuple(layout.find_image(folder, kind, name) for folder in folders) for kind in _MASKS}
    return {kind: files for kind, files in found.items() if any(files)}


def _cameras(files: list[Path]) -> Callable[[int], SourceCamera]:
    """Cameras that are read when they are asked for: there is a file for each frame."""
    for file in files:
        if not file.is_file():
            raise DynhairError("the camera is missing", path=file, expected="a file for every camera of every frame")
    return lambda index: read_camera(files[index])
