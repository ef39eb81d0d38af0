"""What is known of the hair at rest: masks and orientations from every view of the motionless head."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.avatar import HeadPose
from dynhair.camera import Camera
from dynhair.capture import Capture, View
from dynhair.strands import encode_orientation
from dynhair.training.frames import hair_mask


@dataclass(frozen=True)
class RestViews:
    """Views of the hair at rest, all of one size.

    Attributes:
        cameras: in the head frame, so that what they see need not be posed.
        hair: coverage of visible hair in [0, 1].
        direction: the hair's image direction as a doubled angle ``(cos 2a, sin 2a)``, weighted by its coherence and
            by the coverage; zeros without orientation maps.
    """

    cameras: list[Camera]
    hair: Float[Tensor, "v h w"]
    direction: Float[Tensor, "v h w 2"]

    def __len__(self) -> int:
        return len(self.cameras)

    def __getitem__(self, chosen: Sequence[int]) -> RestViews:
        """Some of the views."""
        picked = list(chosen)
        return RestViews([self.cameras[i] for i in picked], self.hair[picked], self.direction[picked])

    def resized(self, longer: int) -> RestViews:
        """The views with a longer side of ``longer`` pixels; never larger than they are."""
        height, width = self.hair.shape[1:]
        factor = longer / max(height, width)
        if factor >= 1:
            return self
        size = (round(height * factor), round(width * factor))
        maps = torch.cat([self.hair[:, None], self.direction.movedim(-1, 1)], 1)
        maps = functional.interpolate(maps, size, mode="area")
        cameras = [camera.resized(size[1], size[0]) for camera in self.cameras]
        return RestViews(cameras, maps[:, 0], maps[:, 1:].movedim(1, -1).contiguous())


def rest_views(capture: Capture, frame: int, pose: HeadPose) -> RestViews:
    """All views of the head at rest: those of ``frame`` and the static ones.

    Args:
        capture: gives images and cameras.
        frame: the frame whose pose the static views show.
        pose: the head's pose in that frame.

    Raises:
        DynhairError: the capture has no hair masks.
    """
    names = capture.camera_names
    views = capture.views([(frame, name) for name in names])
    cameras = [capture.camera(frame, name) for name in names]
    views += [capture.static_view(name) for name in capture.static_names]
    cameras += [capture.static_camera(name) for name in capture.static_names]
    hair, direction = zip(*(_maps(capture, view) for view in views), strict=True)
    return RestViews([_in_head_frame(camera, pose) for camera in cameras], torch.stack(hair), torch.stack(direction))


def _maps(capture: Capture, view: View) -> tuple[Tensor, Tensor]:
    hair = hair_mask(capture, view)
    if view.orientation is None or view.coherence is None:
        return hair, torch.zeros(*hair.shape, 2)
    return hair, encode_orientation(view.orientation) * (view.coherence * hair)[..., None]


def _in_head_frame(camera: Camera, pose: HeadPose) -> Camera:
    rotation, translation = camera.w2c[:, :3], camera.w2c[:, 3]
    moved = torch.cat([rotation @ pose.rotation, (rotation @ pose.translation + translation)[:, None]], 1)
    return Camera(moved, camera.K, camera.width, camera.height)
