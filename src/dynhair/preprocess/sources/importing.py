"""Writing a recording's pictures, cameras, given masks and clean plates into a workspace."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Lock

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from dynhair.capture.encoding import read_mask, read_rgb
from dynhair.errors import DynhairError
from dynhair.preprocess.jobs import is_fresh, record_settings
from dynhair.preprocess.options import ImportOptions
from dynhair.preprocess.sources.geometry import Rectifier
from dynhair.preprocess.sources.pictures import PictureFrames
from dynhair.preprocess.sources.plan import ImportPlan, plan_import
from dynhair.preprocess.sources.recording import Channel, Recording, SourceCamera
from dynhair.preprocess.workspace import STATIC, ViewId, Workspace
from dynhair.storage import atomic_file

Progress = Callable[[int, int], None]


def import_recording(
    recording: Recording, workspace: Workspace, options: ImportOptions, progress: Progress
) -> tuple[str, ...]:
    """Bring a recording into a workspace: undistorted, cropped, resized, in metres with y up.

    What is there already, and was made with the same options and lenses, is not written again; a video of which
    everything is there is not decoded.

    Args:
        recording: what `open_recording` found.
        workspace: where to write; its manifest is written at the end.
        options: what to take, and in which size.
        progress: called with the number of views that are there, first those of an earlier import, and that of all.

    Returns:
        What the user should know, a sentence each.

    Raises:
        DynhairError: as for `plan_import`, or a picture, a video or a mask is damaged.
    """
    plan = plan_import(recording, options)
    importer = _Importer(workspace, plan, options, progress)
    importer.record(recording)
    importer.write_plates(recording)
    importer.run()
    static = () if plan.static is None else tuple(plan.static.channels)
    workspace.write_manifest(plan.manifest, static)
    return (*plan.notes, *importer.notes)


@dataclass(frozen=True)
class _Job:
    """One camera's part of one shot, or one static view.

    Attributes:
        channel: where it comes from.
        views: index of a frame in the channel to the view that it becomes, ascending.
        stored: width and height of its pictures.
    """

    channel: Channel
    views: Mapping[int, ViewId]
    stored: tuple[int, int]

    def masks(self, index: int) -> Iterator[tuple[str, Path]]:
        """Yield kind and file of the masks that a frame came with."""
        for kind, files in self.channel.masks.items():
            if (source := files[index]) is not None:
                yield kind, source


class _Importer:
    """The work of one import, shared by threads: a thread for each video, as many as there are cores."""

    def __init__(self, workspace: Workspace, plan: ImportPlan, options: ImportOptions, progress: Progress) -> None:
        self._workspace, self._plan, self._options = workspace, plan, options
        self._progress = progress
        self._jobs = list(_jobs(plan))
        self._total = sum(len(job.views) for job in self._jobs)
        self._done = 0
        self._lock, self._stop = Lock(), Event()
        self._pictures_record = workspace.folder / "import" / "pictures.json"
        self._cameras_record = workspace.folder / "import" / "cameras.json"
        self.notes: list[str] = []

    def record(self, recording: Recording) -> None:
        """Keep what pictures and cameras depend on; what is older than a change of it is written anew."""
        plan, options = self._plan, self._options
        first = plan.shots[0]
        cameras = {name: first.take.channels[name].camera(first.indices[0]) for name in plan.camera_names}
        pictures = {
            "recording": str(recording.path.resolve()),
            "takes": [[shot.take.name, shot.segment.start, shot.segment.count] for shot in plan.shots],
            "start": options.start,
            "stride": options.stride,
            "crop": options.crop if isinstance(options.crop, str) else list(options.crop or ()),
            "size": list(plan.manifest.image_size),
            "lenses": {
                name: {"K": camera.K.tolist(), "distortion": camera.distortion.tolist(), "fisheye": camera.fisheye}
                for name, camera in cameras.items()
            },
        }
        record_settings(self._pictures_record, pictures)
        poses = {name: plan.world.to_metres(camera.w2c).tolist() for name, camera in cameras.items()}
        record_settings(self._cameras_record, {"pictures": pictures, "poses": poses})

    def run(self) -> None:
        """Write everything that is not there yet."""
        pending = [(job, [index for index in job.views if not self._is_there(job, index)]) for job in self._jobs]
        self._done = self._total - sum(len(indices) for _, indices in pending)
        self._progress(self._done, self._total)
        pending = [(job, indices) for job, indices in pending if indices]
        with ThreadPoolExecutor(min(os.cpu_count() or 1, len(pending)) or 1) as pool:
            futures = [pool.submit(self._write, job, indices) for job, indices in pending]
            try:
                for future in as_completed(futures):
                    future.result()
            except BaseException:  # Ctrl-C too: threads are waited for, so they must hear of it
                self._stop.set()
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    def write_plates(self, recording: Recording) -> None:
        """Bring the clean plates to the pictures' geometry."""
        import cv2

        for name, source in recording.plates.items():
            target = self._workspace.plate_path(name)
            if name not in self._plan.camera_names or is_fresh((target,), (self._pictures_record, source)):
                continue
            stored = self._plan.stored_size[name]
            pixels = read_rgb(source)
            if pixels.shape[1::-1] != stored:
                pixels = cv2.resize(pixels, stored, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
            camera = self._plan.shots[0].take.channels[name].camera(0)
            _write_png(target, self._rectifier(camera, stored)(pixels))

    def _write(self, job: _Job, pending: Sequence[int]) -> None:
        """Write what is missing of one job, in one pass over its frames."""
        last: tuple[int, SourceCamera, Rectifier] | None = None

        def geometry(index: int) -> tuple[SourceCamera, Rectifier]:
            nonlocal last
            if last is None or last[0] != index:
                camera = job.channel.camera(index)
                stands_still = last is not None and last[1] is camera  # then its tables are kept
                last = (index, camera, last[2] if last and stands_still else self._rectifier(camera, job.stored))
            return last[1:]

        for index in pending:
            if self._stop.is_set():
                return
            self._write_camera_and_masks(job, index, *geometry(index))
        pictures = [index for index in pending if not self._has_picture(job, index)]
        self._count(len(pending) - len(pictures))
        for index, pixels in job.channel.frames.read(pictures, self._note):
            if self._stop.is_set():
                return
            self._write_picture(job, index, pixels, geometry(index)[1])
            self._count(1)

    def _write_camera_and_masks(self, job: _Job, index: int, camera: SourceCamera, rectify: Rectifier) -> None:
        view = job.views[index]
        if not self._has_camera(view):
            self._workspace.write_camera(view, self._plan.world.to_metres(camera.w2c), rectify.K)
        for kind, source in job.masks(index):
            if not self._has_mask(view, kind, source):
                _write_png(self._workspace.given_path(view, kind), rectify(_read_mask(source, job.stored)))

    def _write_picture(self, job: _Job, index: int, pixels: UInt8[np.ndarray, "h w 3"], rectify: Rectifier) -> None:
        view, frames = job.views[index], job.channel.frames
        if rectify.is_identity and isinstance(frames, PictureFrames) and _is_plain_jpeg(frames.files[index]):
            with atomic_file(self._workspace.image_path(view)) as path:  # coding it again would only lose
                shutil.copyfile(frames.files[index], path)
        else:
            self._workspace.write_image(view, rectify(pixels))

    def _is_there(self, job: _Job, index: int) -> bool:
        view = job.views[index]
        masks = all(self._has_mask(view, kind, source) for kind, source in job.masks(index))
        return masks and self._has_picture(job, index) and self._has_camera(view)

    def _has_picture(self, job: _Job, index: int) -> bool:
        frames = job.channel.frames
        source = frames.files[index] if isinstance(frames, PictureFrames) else frames.path
        return is_fresh((self._workspace.image_path(job.views[index]),), (self._pictures_record, source))

    def _has_mask(self, view: ViewId, kind: str, source: Path) -> bool:
        return is_fresh((self._workspace.given_path(view, kind),), (self._pictures_record, source))

    def _has_camera(self, view: ViewId) -> bool:
        return is_fresh((self._workspace.camera_path(view),), (self._cameras_record,))

    def _rectifier(self, camera: SourceCamera, stored: tuple[int, int]) -> Rectifier:
        return Rectifier(camera, stored, self._options.crop, self._options.size)

    def _count(self, pictures: int) -> None:
        with self._lock:
            self._done += pictures
            self._progress(self._done, self._total)

    def _note(self, note: str) -> None:
        with self._lock:
            self.notes.append(note)


def _jobs(plan: ImportPlan) -> list[_Job]:
    jobs = [
        _Job(
            channel=shot.take.channels[name],
            views={i: ViewId(frame, name) for i, frame in zip(shot.indices, shot.segment.frames, strict=True)},
            stored=plan.stored_size[name],
        )
        for shot in plan.shots
        for name in plan.camera_names
    ]
    if plan.static is not None:
        for name, channel in plan.static.channels.items():
            jobs.append(_Job(channel, {0: ViewId(STATIC, name)}, channel.frames.size))
    return jobs


def _read_mask(path: Path, size: tuple[int, int]) -> UInt8[np.ndarray, "h w"]:
    mask = read_mask(path)
    if mask.shape[::-1] != size:
        raise DynhairError(
            f"is {mask.shape[1]} x {mask.shape[0]} pixels",
            path=path,
            expected=f"{size[0]} x {size[1]}, as its picture",
        )
    return mask


def _is_plain_jpeg(path: Path) -> bool:
    with Image.open(path) as image:
        return image.format == "JPEG" and image.mode == "RGB"


def _write_png(path: Path, pixels: np.ndarray) -> None:
    with atomic_file(path) as temporary:
        Image.fromarray(pixels).save(temporary)
