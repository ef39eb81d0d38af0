"""What is known of the hair at rest: images, masks and orientations from the views of the motionless head."""

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

_HELD_OUT = 8


@dataclass(frozen=True)
class RestViews:
    """Views of the hair at rest, all of one size.

    Attributes:
        cameras: in the head frame, so that what they see need not be posed.
        rgb: images on the capture's background.
        hair: coverage of visible hair in [0, 1].
        direction: the hair's image direction as a doubled angle ``(cos 2a, sin 2a)``, weighted by its coherence and
            by the coverage; zeros without orientation maps.
    """

    cameras: list[Camera]
    rgb: Float[Tensor, "v h w 3"]
    hair: Float[Tensor, "v h w"]
    direction: Float[Tensor, "v h w 2"]

    def __len__(self) -> int:
        return len(self.cameras)

    def __getitem__(self, chosen: Sequence[int]) -> RestViews:
        """Some of the views."""
        picked = list(chosen)
        cameras = [self.cameras[i] for i in picked]
        return RestViews(cameras, self.rgb[picked], self.hair[picked], self.direction[picked])

    def resized(self, longer: int) -> RestViews:
        """The views with a longer side of ``longer`` pixels; never larger than they are."""
        height, width = self.hair.shape[1:]
        factor = longer / max(height, width)
        if factor >= 1 or not self.cameras:
            return self
        size = (round(height * factor), round(width * factor))
        maps = torch.cat([self.hair[:, None], self.rgb.movedim(-1, 1), self.direction.movedim(-1, 1)], 1)
        maps = functional.interpolate(maps, size, mode="area").movedim(1, -1)
        cameras = [camera.resized(size[1], size[0]) for camera in self.cameras]
        rgb, direction = maps[..., 1:4].contiguous(), maps[..., 4:].contiguous()
        return RestViews(cameras, rgb, maps[..., 0].contiguous(), direction)


def static_view_names(capture: Capture, *, held_out: bool = False) -> list[str]:
    """The static views that training sees; every eighth is held out, to judge by.

    Args:
        capture: which may have none.
        held_out: the held-out ones instead.
    """
    return [name for place, name in enumerate(capture.static_names) if (place % _HELD_OUT == 3) == held_out]


def rest_views(
    capture: Capture, frame: int, pose: HeadPose, *, held_out: bool = False, largest: int | None = None
) -> RestViews:
    """The views of the head at rest that training sees: those of ``frame`` and the static ones.

    Every eighth static view is held out, so that the hairstyle can be judged from where it was not fitted.

    Args:
        capture: gives images and cameras.
        frame: the frame whose pose the static views show.
        pose: the head's pose in that frame.
        held_out: the held-out static views instead; there may be none.
        largest: longer side of the images, pixels, if they are to be reduced.

    Raises:
        DynhairError: the capture has no hair masks.
    """
    static = static_view_names(capture, held_out=held_out)
    names = [] if held_out else capture.camera_names
    views = capture.views([(frame, name) for name in names])
    cameras = [capture.camera(frame, name) for name in names]
    views += [capture.static_view(name) for name in static]
    cameras += [capture.static_camera(name) for name in static]
    loaded = [
        _loaded(capture, view, _in_head_frame(camera, pose), largest)
        for view, camera in zip(views, cameras, strict=True)
    ]
    if not loaded:
        width, height = capture.image_size
        return RestViews(
            [], torch.empty(0, height, width, 3), torch.empty(0, height, width), torch.empty(0, height, width, 2)
        )
    return RestViews(
        [view.cameras[0] for view in loaded],
        torch.cat([view.rgb for view in loaded]),
        torch.cat([view.hair for view in loaded]),
        torch.cat([view.direction for view in loaded]),
    )


def _loaded(capture: Capture, view: View, camera: Camera, largest: int | None) -> RestViews:
    hair, direction = _maps(capture, view)
    whole = RestViews([camera], view.rgb[None], hair[None], direction[None])
    return whole if largest is None else whole.resized(largest)


def _maps(capture: Capture, view: View) -> tuple[Tensor, Tensor]:
    hair = hair_mask(capture, view)
    if view.orientation is None or view.coherence is None:
        return hair, torch.zeros(*hair.shape, 2)
    return hair, encode_orientation(view.orientation) * (view.coherence * hair)[..., None]


def _in_head_frame(camera: Camera, pose: HeadPose) -> Camera:
    rotation, translation = camera.w2c[:, :3], camera.w2c[:, 3]
    moved = torch.cat([rotation @ pose.rotation, (rotation @ pose.translation + translation)[:, None]], 1)
    return Camera(moved, camera.K, camera.width, camera.height)
