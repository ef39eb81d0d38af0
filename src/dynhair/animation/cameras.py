"""What films an avatar: the recording's front camera, an orbit, a capture's camera, or a path of key frames."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.animation.camera_files import LEAST_DISTANCE, CameraPath, read_camera_path
from dynhair.animation.capture_names import capture_in
from dynhair.avatar.recording import Recording
from dynhair.camera import Camera
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.motion import RestAlignment
from dynhair.training.rest import Rest

NAMED_CAMERAS = ("front", "orbit")


def camera_path(
    spec: str | Path,
    recording: Recording,
    frames: int,
    size: int | None = None,
    *,
    capture: Path | str | None = None,
) -> list[Camera]:
    """A camera for each frame of a clip.

    Args:
        spec: ``front``: the recording's camera that the face looks at most, which stays where it is. ``orbit``: that
            camera once round the head within the clip; ``orbit:30`` at 30 degrees a second, negative the other way
            round. A ``.json`` file: a path of key frames (docs/animate.md). Anything else: a camera of ``capture``, or
            ``CAPTURE:CAMERA``, which sees the avatar as it saw the capture's person.
        recording: how the avatar's own person was recorded.
        frames: of the clip.
        size: pixels of the images' longer side; those of the camera itself by default.
        capture: whose cameras a name may mean.

    Raises:
        DynhairError: nothing is meant by the specification, what it means cannot be read, or the size is not positive.
    """
    spec = str(spec)
    if size is not None and not size > 0:
        raise DynhairError(f"images of {size} pixels", expected="a positive size")
    kind, _, rate = spec.partition(":")
    if kind == "orbit":
        cameras = _orbit(recording, frames, _degrees(rate))
    elif spec == "front":
        cameras = [recording.camera] * frames
    elif Path(spec).suffix.lower() == ".json":
        cameras = _along(read_camera_path(spec), recording, frames)
    else:
        cameras = [_captured(spec, recording, capture)] * frames
    return [_sized(camera, size) for camera in cameras]


def names_camera(spec: str | Path) -> bool:
    """Whether a specification can only mean a camera of a capture that it does not name itself."""
    known = str(spec).partition(":")[0] in NAMED_CAMERAS or Path(spec).suffix.lower() == ".json"
    return not known and capture_in(str(spec)) is None


def upwards(recording: Recording) -> Float64[np.ndarray, " 3"]:
    """The unit vector against gravity, in the world."""
    return -recording.gravity / np.linalg.norm(recording.gravity)


def _orbit(recording: Recording, frames: int, rate: float | None) -> list[Camera]:
    """The front camera turned about the vertical through the resting head."""
    turns = np.arange(frames) / frames if rate is None else np.arange(frames) / recording.fps * rate / 360
    centre = recording.rest.translation.double().numpy()
    rotations = Rotation.from_rotvec(2 * math.pi * turns[:, None] * upwards(recording)).as_matrix()
    return [RestAlignment(turn, centre, centre).camera(recording.camera) for turn in rotations]


def _degrees(text: str) -> float | None:
    if not text:
        return None
    with suppress(ValueError):
        if math.isfinite(rate := float(text)):
            return rate
    raise DynhairError(f"an orbit of `{text}` degrees a second", expected="a number, as in orbit:30")


def _along(path: CameraPath, recording: Recording, frames: int) -> list[Camera]:
    """Cameras on a path, that look at its targets, upright."""
    front, up = recording.camera, upwards(recording)
    rotation, origin = recording.rest.rotation.double().numpy(), recording.rest.translation.double().numpy()
    times = np.arange(frames) / recording.fps
    shots = path.at(times)
    (through,) = np.nonzero(np.linalg.norm(shots.positions - shots.targets, axis=1) < LEAST_DISTANCE)
    if len(through):
        found = f"at {times[through[0]]:g} s the camera passes through what it looks at"
        raise DynhairError(found, path=path.path, mend="lead it round by another key frame")
    cameras = []
    for position, target, angle in zip(shots.positions, shots.targets, shots.fields_of_view, strict=True):
        if path.space == "head":
            position, target = rotation @ position + origin, rotation @ target + origin  # noqa: PLW2901
        focal = front.height / 2 / math.tan(math.radians(angle) / 2)
        K = torch.tensor([[focal, 0, front.width / 2], [0, focal, front.height / 2], [0, 0, 1]], dtype=torch.float32)
        cameras.append(Camera(looking_at(position, target, up), K, front.width, front.height))
    return cameras


def looking_at(
    position: Float64[np.ndarray, " 3"], target: Float64[np.ndarray, " 3"], up: Float64[np.ndarray, " 3"]
) -> Float[Tensor, "3 4"]:
    """World-to-camera ``[R | t]`` (3, 4) of an upright camera; one that looks straight down or up turns as it can."""
    forward = (target - position) / np.linalg.norm(target - position)
    sideways = np.cross(forward, up)
    if np.linalg.norm(sideways) < 1e-6:
        sideways = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(forward)))])
    right = sideways / np.linalg.norm(sideways)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return torch.from_numpy(np.column_stack([rotation, -rotation @ position])).float()


def _captured(spec: str, recording: Recording, capture: Path | str | None) -> Camera:
    """A capture's camera, moved with the capture's resting head to the avatar's."""
    named = capture_in(spec)
    folder, name = named or (capture, spec)
    if folder is None:
        raise DynhairError(
            f"nothing is known by the camera `{spec}`",
            expected=f"{', '.join(NAMED_CAMERAS)}, a path of key frames (.json), CAPTURE:CAMERA, or a camera's name",
            mend="name the camera's capture by --capture",
        )
    opened = Capture.open(folder, cache_bytes=0)
    rest = Rest.of(opened)
    own = recording.rest.rotation.double().numpy(), recording.rest.translation.double().numpy()
    return RestAlignment.between(rest.pose, own).camera(opened.camera(rest.frame, name))


def _sized(camera: Camera, size: int | None) -> Camera:
    if size is None:
        return camera
    scale = size / max(camera.width, camera.height)
    return camera.resized(max(1, round(camera.width * scale)), max(1, round(camera.height * scale)))
