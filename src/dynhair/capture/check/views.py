"""Checks of one view: its images decode and agree with each other, with the camera and with the head."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynhair.capture.arrays import read_npy
from dynhair.capture.check.cameras import CameraFile
from dynhair.capture.check.findings import Finding
from dynhair.capture.encoding import open_image, read_mask, read_orientation
from dynhair.capture.layout import Layout
from dynhair.errors import DynhairError

_GRID = 64  # maps are compared on so many rows and columns
_MIN_ON_PERSON = 0.5  # of the landmarks: hair and hands do not hide the mask
_REPROJECTION = (0.02, 0.1)  # of the image's width: warning, error
_BACKGROUND_TOLERANCE = 0.1


@dataclass(frozen=True)
class ViewJob:
    """One view to check.

    Attributes:
        folder: of its images.
        name: of the view.
        camera: the camera's file.
        head: points of the head (N, 3) in the world, or None if unknown.
        landmarks: file of the landmarks in the image, which need not exist; None for a static view.
    """

    folder: Path
    name: str
    camera: Path
    head: np.ndarray | None
    landmarks: Path | None = None


class ViewChecker:
    """Checks views; may be called from several threads.

    Args:
        layout: where the files are.
        size: width and height that images should have.
        kinds: maps that every view should have, beside ``image`` and ``mask``.
        background: colour that the images should stand on; None if they show their own.
    """

    def __init__(
        self,
        layout: Layout,
        size: tuple[int, int],
        kinds: tuple[str, ...],
        background: tuple[float, float, float] | None,
    ) -> None:
        self.layout = layout
        self.size = size
        self.kinds = kinds
        self.background = background

    def __call__(self, job: ViewJob) -> list[Finding]:
        """Check one view."""
        return list(self._check(job))

    def _check(self, job: ViewJob) -> Iterator[Finding]:
        maps: dict[str, np.ndarray] = {}
        files: dict[str, Path] = {}
        for kind in ("image", "mask", *self.kinds):
            try:
                files[kind], maps[kind] = self._decode(job, kind)
            except DynhairError as error:
                yield Finding.from_error(error, self.layout.root)
        yield from self._content_faults(files, maps)
        camera = None
        try:
            camera = CameraFile(job.camera, self.size)
        except DynhairError as error:
            yield Finding.from_error(error, self.layout.root)
        if camera is not None:
            yield from self._camera_faults(job, camera, files.get("mask"), maps.get("mask"))

    def _decode(self, job: ViewJob, kind: str) -> tuple[Path, np.ndarray]:
        """The file and its pixels on the grid; every byte of the file is decoded."""
        path = self.layout.find_image(job.folder, kind, job.name)
        if path is None:
            raise DynhairError(
                "the file is missing",
                path=job.folder / f"{kind}_{job.name}.png",
                expected="a .png or .jpg, as the other views have",
                mend="write it, or leave its frame out of the segments",
            )
        read: dict[str, Callable[[Path], np.ndarray]] = {
            "image": _read_small_rgb,
            "orient": read_orientation,
        }
        with open_image(path) as image:
            size = image.size
        if size != self.size:
            raise DynhairError(
                f"is {size[0]} x {size[1]} pixels",
                path=path,
                expected=f"{self.size[0]} x {self.size[1]}",
                mend="write all images of the capture in one size and say it in capture.json as `image_size`",
            )
        return path.relative_to(self.layout.root), _on_grid(read.get(kind, read_mask)(path))

    def _content_faults(self, files: dict[str, Path], maps: dict[str, np.ndarray]) -> Iterator[Finding]:
        rgb, mask, hair, orientation = (maps.get(kind) for kind in ("image", "mask", "hair", "orient"))
        if mask is not None and mask.max() < 128:
            yield Finding("warning", files["mask"], "the mask is empty", "the person, white", "segment this view again")
        if mask is not None and mask.min() > 127:
            yield Finding(
                "warning", files["mask"], "the mask covers the whole image", "the person alone", "segment it again"
            )
        if rgb is not None and np.ptp(rgb) == 0:
            yield Finding("warning", files["image"], "the image has one colour", "a picture", "write it again")
        if rgb is not None and mask is not None and self.background is not None and (mask == 0).any():
            shown = np.median(rgb[mask == 0], axis=0) / 255
            if np.abs(shown - self.background).max() > _BACKGROUND_TOLERANCE:
                colour = ", ".join(f"{c:.2f}" for c in shown)
                yield Finding(
                    "warning",
                    files["image"],
                    f"outside the mask the image is ({colour})",
                    "`background` of capture.json: (" + ", ".join(f"{c:.2f}" for c in self.background) + ")",
                    "set `background`; null if images show their own background",
                )
        if hair is not None and mask is not None and (hair > 127).any():
            stray = float((mask[hair > 127] < 64).mean())
            if stray > 0.1:
                yield Finding(
                    "warning",
                    files["hair"],
                    f"{stray:.0%} of the hair is outside the person's mask",
                    "hair inside the mask",
                    "check that both masks are of the same view and frame",
                )
        if hair is not None and orientation is not None and (hair > 200).sum() >= 16:
            blank = float((orientation[..., 1][hair > 200] < 16).mean())
            if blank > 0.5:
                yield Finding(
                    "warning",
                    files["orient"],
                    f"{blank:.0%} of the hair has no orientation",
                    "coherence in the alpha channel, above 0 on hair",
                    "compute the orientation map again",
                )

    def _camera_faults(
        self, job: ViewJob, camera: CameraFile, mask_file: Path | None, mask: np.ndarray | None
    ) -> Iterator[Finding]:
        file = job.camera.relative_to(self.layout.root)
        matrix_faults = list(camera.faults(file))
        yield from matrix_faults
        if job.head is None or matrix_faults:
            return
        head_faults = list(camera.head_faults(file, job.head))
        yield from head_faults
        if head_faults or len(job.head) == 1:
            return
        pixels, _ = camera.project(job.head)
        if mask is not None and mask_file is not None and mask.max() > 127:
            cells = np.clip(pixels / self.size * _GRID, 0, _GRID - 1).astype(int)
            share = float((mask[cells[:, 1], cells[:, 0]] > 25).mean())
            if share < _MIN_ON_PERSON:
                yield Finding(
                    "warning",
                    mask_file,
                    f"{share:.0%} of the head's landmarks fall on the person's mask",
                    f"{_MIN_ON_PERSON:.0%} or more",
                    "check that camera, mask and landmarks are of the same view and frame",
                )
        yield from self._landmark_faults(job, pixels)

    def _landmark_faults(self, job: ViewJob, projected: np.ndarray) -> Iterator[Finding]:
        if job.landmarks is None or not job.landmarks.exists():
            return
        try:
            detected = np.delete(read_npy(job.landmarks, (68, 3)), [48, 54], 0)
        except DynhairError as error:
            yield Finding.from_error(error, self.layout.root)
            return
        sure = detected[:, 2] > 0.5  # a failed detection is written as zeros
        if not sure.any():
            return
        error = float(np.median(np.linalg.norm(detected[sure, :2] - projected[sure], axis=1)))
        warn, fail = (limit * self.size[0] for limit in _REPROJECTION)
        if error > warn:
            yield Finding(
                "error" if error > fail else "warning",
                job.landmarks.relative_to(self.layout.root),
                f"3D landmarks project {error:.1f} px from those in the image (median)",
                f"less than {warn:.1f} px",
                "check the calibration, the scale of K, and that the frames are in step",
            )


def _read_small_rgb(path: Path) -> np.ndarray:
    with open_image(path) as image:
        image.draft("RGB", (_GRID, _GRID))  # a JPEG's every byte is still read, at a fraction of the work
        return np.array(image.convert("RGB"))


def _on_grid(pixels: np.ndarray) -> np.ndarray:
    rows, columns = (((np.arange(_GRID) + 0.5) * n / _GRID).astype(int) for n in pixels.shape[:2])
    return pixels[rows[:, None], columns]
