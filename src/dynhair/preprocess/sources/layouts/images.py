"""``images/TAKE/CAMERA/0000.png`` and a calibration."""

from __future__ import annotations

from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.calibration import Calibration, read_calibration
from dynhair.preprocess.sources.layouts.videos import folders_in, plates
from dynhair.preprocess.sources.pictures import PictureFrames, frame_numbers, picture_files
from dynhair.preprocess.sources.recording import Channel, Recording, Take


def matches(path: Path) -> bool:
    """Whether a folder looks like it."""
    return bool(_takes(path))


def open_images(path: Path, calibration: Path | None) -> Recording:
    """Open it; ``background/CAMERA.png`` are clean plates.

    Raises:
        DynhairError: an image is missing in the middle, or cameras have images of different numbers.
    """
    named = _takes(path)
    if not named:
        raise DynhairError("no images are there", path=path / "images", expected="TAKE/CAMERA/0000.png")
    table = read_calibration(calibration, path)
    takes = tuple(_take(name, cameras, table) for name, cameras in named.items())
    return Recording(
        path=path,
        layout="images",
        takes=takes,
        notes=table.notes(takes),
        world=table.world,
        plates=plates(path / "background"),
    )


def _takes(path: Path) -> dict[str, dict[str, list[Path]]]:
    takes = {
        take.name: {camera.name: files for camera in folders_in(take) if (files := picture_files(camera))}
        for take in folders_in(path / "images")
    }
    return {name: cameras for name, cameras in takes.items() if cameras}


def _take(name: str, cameras: dict[str, list[Path]], calibration: Calibration) -> Take:
    numbers = {camera: set(frame_numbers(files) or ()) for camera, files in cameras.items()}
    first, *others = cameras
    for other in others:
        if numbers[first] and numbers[other] and (odd := numbers[first] ^ numbers[other]):
            has, lacks = (first, other) if min(odd) in numbers[first] else (other, first)
            raise DynhairError(
                f"camera `{has}` has an image {min(odd)} and `{lacks}` has not",
                path=cameras[lacks][0].parent,
                expected="images of the same numbers from all cameras",
                mend="add the images that are missing, or remove those that only some cameras have",
            )
    return Take(
        name,
        {
            camera: Channel(PictureFrames(files[0].parent, tuple(files)), calibration.fixed(camera))
            for camera, files in cameras.items()
        },
    )
