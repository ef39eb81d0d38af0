"""Which frame and views each training step sees, and their images: a pure function of the seed and the step."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.camera import Camera
from dynhair.capture import Capture, Segment, View
from dynhair.training.frames import hair_mask
from dynhair.training.static_views import static_view_names


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


@dataclass(frozen=True)
class Choice:
    """What a step sees.

    Attributes:
        segment: index among the training segments.
        index: frame inside the segment.
        names: of the views.
        static: whether these are static views.
    """

    segment: int
    index: int
    names: list[str]
    static: bool


class Batches:
    """Training batches by step number: every frame once an epoch, in random order, from random views.

    A step's batch depends on the seed and the step alone, so that a resumed run sees what an uninterrupted one sees.
    Now and then a step sees the rest frame from its static views: what no camera of the motions faces (a back, a nape)
    would be left to the noise of gradients otherwise.

    Args:
        capture: the images.
        segments: the training segments.
        views: views a step; fewer if the capture has fewer.
        image_size: longer side of the images, pixels; larger images are reduced.
        seed: of the order.
        static_every: every so many steps the static views are seen, where the capture has them; never if 0.
    """

    def __init__(
        self,
        capture: Capture,
        segments: Sequence[Segment],
        *,
        views: int,
        image_size: int,
        seed: int,
        static_every: int = 0,
    ) -> None:
        self.capture = capture
        self.segments = segments
        self.views = min(views, len(capture.camera_names))
        self.image_size = image_size
        self.seed = seed
        self._rest = _place(segments, capture.static_frame)
        self._static_names = static_view_names(capture) if static_every and self._rest is not None else []
        self._static_every = static_every
        self._frames = [(s, i) for s, segment in enumerate(segments) for i in range(segment.count)]

    def choice(self, step: int) -> Choice:
        """What a step sees."""
        if self._rest is not None and self._static_names and (step + 1) % self._static_every == 0:
            return Choice(*self._rest, self._drawn(self._static_names, step), static=True)
        epoch, position = divmod(step, len(self._frames))
        order = torch.randperm(len(self._frames), generator=self._generator(2 * epoch))
        segment, index = self._frames[int(order[position])]
        return Choice(segment, index, self._drawn(self.capture.camera_names, step), static=False)

    def batch(self, step: int) -> Batch:
        """The batch of a step."""
        chosen = self.choice(step)
        return load_batch(
            self.capture,
            self.segments,
            chosen.segment,
            chosen.index,
            chosen.names,
            self.image_size,
            static=chosen.static,
        )

    def from_step(self, step: int, stop: int) -> Iterator[Batch]:
        """The batches of steps ``step .. stop - 1``, each read while the one before is in use."""
        with ThreadPoolExecutor(1) as reader:
            upcoming = reader.submit(self.batch, step) if step < stop else None
            for following in range(step + 1, stop + 1):
                assert upcoming is not None
                batch = upcoming.result()
                upcoming = reader.submit(self.batch, following) if following < stop else None
                yield batch

    def _drawn(self, names: Sequence[str], step: int) -> list[str]:
        order = torch.randperm(len(names), generator=self._generator(2 * step + 1))[: self.views]
        return [names[int(view)] for view in order]

    def _generator(self, stream: int) -> torch.Generator:
        return torch.Generator().manual_seed(self.seed * 1_000_003 + stream)


def load_batch(
    capture: Capture,
    segments: Sequence[Segment],
    segment: int,
    index: int,
    names: Sequence[str],
    image_size: int,
    *,
    static: bool = False,
) -> Batch:
    """The images of one frame from the named views, which are static views of the rest frame if so said.

    Raises:
        DynhairError: the capture has no hair masks.
    """
    frame = segments[segment].start + index
    if static:
        views, seen_by = [capture.static_view(name) for name in names], capture.static_camera
    else:
        views, seen_by = capture.views([(frame, name) for name in names]), partial(capture.camera, frame)
    width, height = _reduced(capture.image_size, image_size)
    maps = [_maps(capture, view, (height, width)) for view in views]
    rgb, hair, body, orientation, coherence = (torch.stack(items) for items in zip(*maps, strict=True))
    cameras = [seen_by(name).resized(width, height) for name in names]
    return Batch(segment, index, cameras, rgb, hair, body, orientation, coherence)


def _place(segments: Sequence[Segment], frame: int) -> tuple[int, int] | None:
    """The segment's index and the frame's inside it; None if no segment has it."""
    for number, segment in enumerate(segments):
        if frame in segment.frames:
            return number, frame - segment.start
    return None


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
