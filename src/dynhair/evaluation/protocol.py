"""Self-reenactment: a capture's own motions drive the avatar, and its images are held against the capture's.

The avatar sees each segment's tracked head pose and expression, never its images. Segments held out from training are
evaluated in every frame, the others in every few; all views always. The same avatar with its hair held rigid runs
beside it, since a figure says little without the figure that no hair motion at all would get.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

import torch
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.appearance import Appearance
from dynhair.evaluation.cost import Stopwatch
from dynhair.evaluation.figures import Figures, FigureSums
from dynhair.evaluation.head_meter import Drawn
from dynhair.evaluation.held_out import HeldOutViews
from dynhair.evaluation.records import EvaluatedFrame, Evaluation, SegmentFigures
from dynhair.evaluation.segment_meter import SegmentMeter, SegmentTruths
from dynhair.evaluation.true_motion import RestingHair, in_head
from dynhair.evaluation.truth import true_frames, true_strands

_Part = TypeVar("_Part")

TRAINING_STRIDE = 5
"""Of a training segment's frames, one in this many is evaluated."""


@runtime_checkable
class DrivenHead(Protocol):
    """What is evaluated: anything that a head track poses and cameras see, such as an `Avatar`.

    A method that can hold its hair rigid has a rigid twin, which is evaluated beside it; others ignore ``rigid_hair``.
    """

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> Any:
        """Pose by one frame of a track.

        The result has ``strands (n, l, 3)``, world, metres; or, of a method without strands, None there, and the
        positions of its Gaussians, ``means (g, 3)``.
        """
        ...

    def draw(self, posed: Any, cameras: Sequence[Camera]) -> Any:
        """Images from the cameras: ``rgb (v, h, w, 3)`` and the hair's coverage ``hair (v, h, w)`` or None.

        The coverage of head and body, ``body (v, h, w)``, is measured where there is one.
        """
        ...


def evaluated_indices(segment: Segment) -> range:
    """Places in the segment that are evaluated: all of a test segment, every `TRAINING_STRIDE`-th of a training one."""
    return range(0, segment.count, 1 if segment.split == "test" else TRAINING_STRIDE)


def evaluated_segments(capture: Capture, training: bool) -> list[Segment]:
    """A capture's segments; without the training ones, those held out alone, where there are any."""
    held_out = [segment for segment in capture.segments if segment.split == "test"]
    return held_out if held_out and not training else list(capture.segments)


@torch.no_grad()
def evaluate_avatar(
    avatar: DrivenHead,
    capture: Capture,
    *,
    held_out: HeldOutViews | None = None,
    appearance: Appearance | None = None,
    observe: Callable[[EvaluatedFrame], None] | None = None,
    training: bool = True,
) -> Evaluation:
    """Drive the avatar by each segment's track and hold it against the capture, in constant memory.

    Hair rests in the capture's first frame: displacements of the true strands count from there.

    Args:
        avatar: what is evaluated.
        capture: the truth. Its true strands, where it has them, serve the figures of hair motion alone.
        held_out: cameras that training did not use.
        appearance: networks that compare images; the published ones when left out.
        observe: called with each frame's images once they are measured.
        training: whether training segments are measured as well as those held out.

    Raises:
        DynhairError: the avatar renders values that are not finite.
    """
    watch, measured = Stopwatch(), evaluated_segments(capture, training)
    held_out = held_out or HeldOutViews()
    appearance = (appearance or Appearance.published()).for_images(*capture.image_size)
    twins = (False, True) if has_rigid_twin(avatar, capture, measured[0]) else (False,)
    rest = _resting_hair(avatar, capture)
    session = _Session(avatar, capture, measured, twins, held_out, rest, appearance, observe, watch)
    overall = session.sums()
    segments = []
    for segment in session.segments:
        meters = session.measure(segment)
        figures = [meter.sums.figures() for meter in meters]
        segments.append(SegmentFigures(segment, figures[0], _second(figures), meters[0].series.values))
        if segment.split == "test":
            for whole, meter in zip(overall, meters, strict=True):
                whole.merge(meter.sums)
    figures = [part.figures() for part in overall]
    if not overall[0].frames:
        figures = [Figures.unmeasured("the capture has no test segment") for _ in overall]
    apart = [part.held_out.figures() for part in overall if part.held_out is not None and part.frames]
    return Evaluation(
        avatar=figures[0],
        rigid=_second(figures),
        segments=tuple(segments),
        held_out=(apart[0], _second(apart)) if apart else None,
        held_out_views=held_out,
        protocol=session.protocol(),
        image_size=capture.image_size,
        cost=watch.cost(sum(part.avatar.frames for part in segments), len(capture.camera_names)),
    )


def has_rigid_twin(avatar: DrivenHead, capture: Capture, segment: Segment) -> bool:
    """Whether holding its hair rigid makes a difference to a method, so that this is evaluated beside it.

    Args:
        avatar: the method.
        capture: whose motion drives it.
        segment: by whose middle frame this is told.
    """
    track, middle = capture.track(segment), segment.count // 2
    strands = avatar.pose(track, middle).strands
    return strands is not None and not torch.equal(strands, avatar.pose(track, middle, rigid_hair=True).strands)


@dataclass(frozen=True)
class _Session:
    """What all segments of an evaluation share.

    Attributes:
        segments: that are measured.
        twins: whether the hair is held rigid in what is measured side by side: in the avatar not, in its twin it is.
    """

    avatar: DrivenHead
    capture: Capture
    segments: Sequence[Segment]
    twins: tuple[bool, ...]
    held_out: HeldOutViews
    rest: RestingHair
    appearance: Appearance
    observe: Callable[[EvaluatedFrame], None] | None
    watch: Stopwatch

    def sums(self) -> list[FigureSums]:
        """Empty sums, of the avatar and of its rigid twin if it has one."""
        apart = self.held_out.within(self.capture.camera_names)
        return [FigureSums(apart) for _ in self.twins]

    def measure(self, segment: Segment) -> list[SegmentMeter]:
        """Measure one segment: the avatar, and its rigid twin if it has one."""
        places = evaluated_indices(segment)
        truths = SegmentTruths(self.capture, segment, len(places), self.rest, self.appearance, self.watch)
        meters = [SegmentMeter(truths, sums, twin=twin) for sums, twin in zip(self.sums(), self.twins, strict=True)]
        for frame in true_frames(self.capture, segment, places):
            truth, images = truths.frame(frame), []
            for meter, rigid_hair in zip(meters, self.twins, strict=True):
                with self.watch.part("drawing"):
                    posed = self.avatar.pose(truths.track, frame.index, rigid_hair=rigid_hair)
                    drawn = draw(self.avatar, posed, truth.cameras, f"frame {frame.index} of '{segment.name}'")
                meter.add(truth, drawn, posed)
                images.append(drawn.rgb)
            if self.observe is not None:
                with self.watch.part("pictures"):
                    self.observe(EvaluatedFrame(segment, frame.index, frame.rgb, images[0], _second(images)))
        for meter in meters:
            meter.finish()
        return meters

    def protocol(self) -> dict[str, str]:
        """Say in words what was held against what."""
        capture, motion = self.capture, self.rest.motion
        measured = any(segment.split != "test" for segment in self.segments)
        training = f"one in {TRAINING_STRIDE}" if measured else "none"
        width, height = capture.image_size
        return {
            "capture": capture.name,
            "drive": "self-reenactment: each segment's tracked head pose and expression, never its images",
            "frames": f"every frame of test segments, {training} of training segments; "
            "the figures outside `segments` are over the test segments together",
            "views": f"all {len(capture.camera_names)}, {width}x{height} pixels: {', '.join(capture.camera_names)}",
            "held_out_views": ", ".join(self.held_out.names) or f"none: {self.held_out.reason}",
            "rigid": "the same avatar, its hair held in its canonical shape and moved with the head"
            if len(self.twins) > 1
            else "none: the method has no hair to hold rigid, or it is rigid as it is",
            "hair_masks": "the hair coverage stored in the capture for the truth, rendered hair coverage for the "
            "avatar where it renders one",
            "true_strands": "none"
            if motion is None
            else f"{motion.true_strands} of {motion.true_points} points from the capture, at rest in its first frame",
            "networks": self.appearance.description,
        }


def draw(avatar: DrivenHead, posed: Any, cameras: Sequence[Camera], where: str) -> Drawn:
    """Render a posed head, and bring the images to the CPU.

    Args:
        avatar: what was posed.
        posed: what its ``pose`` returned.
        cameras: that see it.
        where: the frame, for the error.

    Raises:
        DynhairError: strands, Gaussians or images are not finite.
    """
    points = posed.means if posed.strands is None else posed.strands
    rendered = avatar.draw(posed, [camera.to(points.device) for camera in cameras])
    hair, body = rendered.hair, getattr(rendered, "body", None)
    _require_finite(where, points, rendered.rgb, *(() if hair is None else (hair,)))
    coverages = [None if coverage is None else coverage.cpu() for coverage in (hair, body)]
    return Drawn(rendered.rgb.cpu().clamp(0.0, 1.0), *coverages)


def _resting_hair(avatar: DrivenHead, capture: Capture) -> RestingHair:
    """The avatar's hair at rest, and the truth's in the capture's first frame."""
    segment = capture.segments[0]
    track = capture.track(segment)
    strands = avatar.pose(track, 0, rigid_hair=True).strands
    if strands is not None:
        _require_finite(f"frame 0 of '{segment.name}'", strands)
        strands = in_head(strands, track, 0)
    true = true_strands(capture, segment)
    return RestingHair.of(strands, None if true is None else true[0])


def _second(parts: Sequence[_Part]) -> _Part | None:
    """The rigid twin's part, if there is one."""
    return parts[1] if len(parts) > 1 else None


def _require_finite(where: str, *tensors: Tensor) -> None:
    if not all(tensor.isfinite().all() for tensor in tensors):
        raise DynhairError(
            f"the avatar's strands or images are not finite in {where}",
            mend="take an earlier checkpoint of its training",
        )
