"""Which frame and views each training step sees, and their images: a pure function of seed, step and readable files."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.camera import Camera
from dynhair.capture import Capture, Segment, View
from dynhair.errors import DynhairError
from dynhair.training.frames import hair_mask, training_cameras
from dynhair.training.static_views import static_view_names

MOST_BROKEN = 0.1
"""Training stops once more than this share of the views cannot be read."""


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
        names: of the views.
        first: place of the first of them among all views of the step, of which another process may have the others.
    """

    segment: int
    index: int
    cameras: list[Camera]
    rgb: Float[Tensor, "v h w 3"]
    hair: Float[Tensor, "v h w"]
    body: Float[Tensor, "v h w"]
    orientation: Float[Tensor, "v h w"]
    coherence: Float[Tensor, "v h w"]
    names: Sequence[str] = ()
    first: int = 0

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
        spare: the frame's other views, in the order in which they stand in for those that cannot be read.
        static: whether these are static views.
    """

    segment: int
    index: int
    names: list[str]
    spare: list[str]
    static: bool


class Batches:
    """Training batches by step number: every frame once an epoch, in random order, from random views.

    A step's batch depends on the seed and the step alone, so that a resumed run sees what an uninterrupted one sees.
    Now and then a step sees the rest frame from its static views: what no camera of the motions faces (a back, a nape)
    would be left to the noise of gradients otherwise.

    Where several processes share a step, each reads all its views, so that all know which of them cannot be read, and
    keeps its own.

    Args:
        capture: the images.
        segments: the training segments.
        views: views a step; fewer if the capture has fewer.
        image_size: longer side of the images, pixels; larger images are reduced.
        seed: of the order.
        static_every: every so many steps the static views are seen, where the capture has them; never if 0.
        cameras: how many of the capture's cameras are used, the most frontal ones; all if 0.
        share: of the number of views, the part that batches hold; all of them by default.
        report: told of each view that cannot be read, when it is first met, and the step goes on with other views of
            the frame; without it such a view is an error.
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
        cameras: int = 0,
        share: Callable[[int], slice] = slice,
        report: Callable[[DynhairError], None] | None = None,
    ) -> None:
        self.capture = capture
        self.segments = segments
        self.cameras = training_cameras(capture, cameras)
        self.views = min(views, len(self.cameras))
        self.image_size = image_size
        self.seed = seed
        self._rest = _place(segments, capture.static_frame)
        self._static_names = static_view_names(capture) if static_every and self._rest is not None else []
        self._static_every = static_every
        self._frames = [(s, i) for s, segment in enumerate(segments) for i in range(segment.count)]
        self._own = share(self.views)
        self._report = report
        self._broken: set[tuple[int | None, str]] = set()

    def choice(self, step: int) -> Choice:
        """What a step sees."""
        if self._rest is not None and self._static_names and (step + 1) % self._static_every == 0:
            return Choice(*self._rest, *self._drawn(self._static_names, step), static=True)
        epoch, position = divmod(step, len(self._frames))
        order = torch.randperm(len(self._frames), generator=self._generator(2 * epoch))
        segment, index = self._frames[int(order[position])]
        return Choice(segment, index, *self._drawn(self.cameras, step), static=False)

    def batch(self, step: int) -> Batch:
        """The batch of a step.

        Raises:
            DynhairError: a view cannot be read, and there is nobody to report it to; or too many views cannot be read,
                or all of the frame.
        """
        chosen = self.choice(step)
        views = self._readable(chosen)[self._own]
        batch = _assembled(
            self.capture, self.segments, chosen.segment, chosen.index, views, self.image_size, static=chosen.static
        )
        return dataclasses.replace(batch, first=self._own.start or 0)

    def from_step(self, step: int, stop: int) -> Iterator[Batch]:
        """The batches of steps ``step .. stop - 1``, each read while the one before is in use."""
        with ThreadPoolExecutor(1) as reader:
            upcoming = reader.submit(self.batch, step) if step < stop else None
            for following in range(step + 1, stop + 1):
                assert upcoming is not None
                batch = upcoming.result()
                upcoming = reader.submit(self.batch, following) if following < stop else None
                yield batch

    def _drawn(self, names: Sequence[str], step: int) -> tuple[list[str], list[str]]:
        """The views of a step, and the others in random order."""
        order = torch.randperm(len(names), generator=self._generator(2 * step + 1))
        drawn = [names[int(view)] for view in order]
        return drawn[: self.views], drawn[self.views :]

    def _readable(self, chosen: Choice) -> list[tuple[str, View]]:
        """The chosen views with their names, spare ones in the place of those that cannot be read.

        Where too few are left, some are taken twice, so that processes have even shares.
        """
        frame = None if chosen.static else self.segments[chosen.segment].start + chosen.index
        waiting = [name for name in (*chosen.names, *chosen.spare) if (frame, name) not in self._broken]
        count, found = len(chosen.names), list[tuple[str, View]]()
        while len(found) < count and waiting:
            missing = count - len(found)
            tried, waiting = waiting[:missing], waiting[missing:]
            for name, view in zip(tried, self.capture.attempt_views(frame, tried), strict=True):
                if isinstance(view, DynhairError):
                    self._set_aside(frame, name, view)
                else:
                    found.append((name, view))
        if not found:
            where = "static view" if frame is None else f"view of frame {frame}"
            raise DynhairError(
                f"no {where} can be read",
                path=self.capture.path,
                mend="`dynhair check` names the damaged files: write them again, or leave out the frame",
            )
        return list(islice(cycle(found), self.views))

    def _set_aside(self, frame: int | None, name: str, error: DynhairError) -> None:
        """Note a view that cannot be read."""
        if self._report is None:
            raise error
        self._broken.add((frame, name))
        self._report(error)
        views = len(self._frames) * len(self.cameras) + len(self._static_names)
        if len(self._broken) > max(1, MOST_BROKEN * views):
            raise DynhairError(
                f"{len(self._broken)} of {views} views cannot be read, the last for this: {error.message}",
                path=error.path,
                expected=f"at most {MOST_BROKEN:.0%} of them",
                mend="`dynhair check` names the damaged files: write them again, then go on with --resume",
            ) from error

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
        views = [capture.static_view(name) for name in names]
    else:
        views = capture.views([(frame, name) for name in names])
    return _assembled(
        capture, segments, segment, index, list(zip(names, views, strict=True)), image_size, static=static
    )


def _assembled(
    capture: Capture,
    segments: Sequence[Segment],
    segment: int,
    index: int,
    views: Sequence[tuple[str, View]],
    image_size: int,
    *,
    static: bool,
) -> Batch:
    """A batch of views with their names."""
    seen_by = capture.static_camera if static else partial(capture.camera, segments[segment].start + index)
    width, height = _reduced(capture.image_size, image_size)
    maps = [_maps(capture, view, (height, width)) for _, view in views]
    rgb, hair, body, orientation, coherence = (torch.stack(items) for items in zip(*maps, strict=True))
    names = [name for name, _ in views]
    cameras = [seen_by(name).resized(width, height) for name in names]
    return Batch(segment, index, cameras, rgb, hair, body, orientation, coherence, names)


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
