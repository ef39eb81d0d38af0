"""Which frame and views each training step sees, and their images: a pure function of the seed and the step."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.camera import Camera
from dynhair.capture import Capture, Segment, View
from dynhair.training.frames import hair_mask


@dataclass(frozen=True)
class Batch:
    """One time step from several views.

    Attributes:
        segment: index among the training segments.
        index: frame inside the segment.
        cameras: of the views.
        rgb: images on the capture's background.
        hair: hair coverage in [0, 1].
        body: coverage by head and upper body in [0, 1].
        orientation: hair's angle in [0, 1) of pi; zeros without orientation maps.
        coherence: confidence of the angle in [0, 1]; zeros without orientation maps.
    """

    segment: int
    index: int
    cameras: list[Camera]
    rgb: Float[Tensor, "v h w 3"]
    hair: Float[Tensor, "v h w"]
    body: Float[Tensor, "v h w"]
    orientation: Float[Tensor, "v h w"]
    coherence: Float[Tensor, "v h w"]

    def to(self, device: torch.device) -> Batch:
        """The batch on another device."""
        maps = {name: getattr(self, name).to(device) for name in ("rgb", "hair", "body", "orientation", "coherence")}
        return dataclasses.replace(self, cameras=[camera.to(device) for camera in self.cameras], **maps)


class Batches:
    """Training batches by step number: every frame once an epoch, in random order, from random views.

    A step's batch depends on the seed and the step alone, so that a resumed run sees what an uninterrupted one sees.

    Args:
        capture: the images.
        segments: the training segments.
        views: views a step; fewer if the capture has fewer.
        image_size: longer side of the images, pixels; larger images are reduced.
        seed: of the order.
    """

    def __init__(
        self, capture: Capture, segments: Sequence[Segment], *, views: int, image_size: int, seed: int
    ) -> None:
        self.capture = capture
        self.segments = segments
        self.views = min(views, len(capture.camera_names))
        self.image_size = image_size
        self.seed = seed
        self._frames = [(s, i) for s, segment in enumerate(segments) for i in range(segment.count)]

    def choice(self, step: int) -> tuple[int, int, list[str]]:
        """The segment, the frame inside it, and the views of a step."""
        epoch, position = divmod(step, len(self._frames))
        order = torch.randperm(len(self._frames), generator=self._generator(2 * epoch))
        segment, index = self._frames[int(order[position])]
        names = self.capture.camera_names
        views = torch.randperm(len(names), generator=self._generator(2 * step + 1))[: self.views]
        return segment, index, [names[int(view)] for view in views]

    def batch(self, step: int) -> Batch:
        """The batch of a step."""
        segment, index, names = self.choice(step)
        return load_batch(self.capture, self.segments, segment, index, names, self.image_size)

    def from_step(self, step: int, stop: int) -> Iterator[Batch]:
        """The batches of steps ``step .. stop - 1``, each read while the one before is in use."""
        with ThreadPoolExecutor(1) as reader:
            upcoming = reader.submit(self.batch, step) if step < stop else None
            for following in range(step + 1, stop + 1):
                assert upcoming is not None
                batch = upcoming.result()
                upcoming = reader.submit(self.batch, following) if following < stop else None
                yield batch

    def _generator(self, stream: int) -> torch.Generator:
        return torch.Generator().manual_seed(self.seed * 1_000_003 + stream)


def load_batch(
    capture: Capture, segments: Sequence[Segment], segment: int, index: int, names: Sequence[str], image_size: int
) -> Batch:
    """The images of one frame from the named views.

    Raises:
        DynhairError: the capture has no hair masks.
    """
    frame = segments[segment].start + index
    views = capture.views([(frame, name) for name in names])
    width, height = _reduced(capture.image_size, image_size)
    maps = [_maps(capture, view, (height, width)) for view in views]
    rgb, hair, body, orientation, coherence = (torch.stack(items) for items in zip(*maps, strict=True))
    cameras = [capture.camera(frame, name).resized(width, height) for name in names]
    return Batch(segment, index, cameras, rgb, hair, body, orientation, coherence)


def _reduced(size: tuple[int, int], longer: int) -> tuple[int, int]:
    factor = min(1.0, longer / max(size))
    return round(size[0] * factor), round(size[1] * factor)


def _maps(capture: Capture, view: View, size: tuple[int, int]) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    rgb, mask, hair = view.rgb, view.mask, hair_mask(capture, view)
    angle = torch.zeros_like(hair) if view.orientation is None else view.orientation
    coherence = torch.zeros_like(hair) if view.coherence is None else view.coherence
    if mask.shape != size:
        # undirected angles are averaged as doubled angles, weighted by how much they can be trusted
        doubled = torch.stack([(2 * torch.pi * angle).cos(), (2 * torch.pi * angle).sin()]) * coherence
        stack = torch.cat([rgb.movedim(-1, 0), mask[None], hair[None], doubled])[None]
        stack = functional.interpolate(stack, size, mode="area")[0]
        rgb, mask, hair = stack[:3].movedim(0, -1), stack[3], stack[4]
        coherence = stack[5:].norm(dim=0)
        angle = (torch.atan2(stack[6], stack[5]) / (2 * torch.pi)) % 1.0
    return rgb, hair, (mask - hair).clamp_min(0), angle, coherence
