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
from jaxtyping import Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.cost import Stopwatch
from dynhair.evaluation.figures import MOTION, TEMPORAL_FIGURES, Figures, FigureSums
from dynhair.evaluation.hair_motion import HairMotion, to_head_frame
from dynhair.evaluation.head_meter import Drawn
from dynhair.evaluation.head_truth import HeadTruths
from dynhair.evaluation.held_out import HeldOutViews
from dynhair.evaluation.looks import LooksMeter, TrueLooks
from dynhair.evaluation.meter import Meter
from dynhair.evaluation.perception import Perception
from dynhair.evaluation.records import EvaluatedFrame, Evaluation, SegmentFigures
from dynhair.evaluation.series import Series
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

    def render(self, posed: Any, cameras: Sequence[Camera]) -> Any:
        """Images from the cameras: ``rgb (v, h, w, 3)`` and the hair's coverage ``hair (v, h, w)`` or None.

        The coverage of head and body, ``body (v, h, w)``, is measured where there is one.
        """
        ...


def evaluated_indices(segment: Segment) -> range:
    """Places in the segment that are evaluated: all of a test segment, every `TRAINING_STRIDE`-th of a training one."""
    return range(0, segment.count, 1 if segment.split == "test" else TRAINING_STRIDE)


@torch.no_grad()
def evaluate_avatar(
    avatar: DrivenHead,
    capture: Capture,
    *,
    held_out: HeldOutViews | None = None,
    perception: Perception | None = None,
    observe: Callable[[EvaluatedFrame], None] | None = None,
) -> Evaluation:
    """Drive the avatar by each segment's track and hold it against the capture, in constant memory.

    Hair rests in the capture's first frame: displacements of the true strands count from there.

    Args:
        avatar: what is evaluated.
        capture: the truth. Its true strands, where it has them, serve the figures of hair motion alone.
        held_out: cameras that training did not use.
        perception: for LPIPS; the published network when left out.
        observe: called with each frame's images once they are measured.

    Raises:
        DynhairError: the avatar renders values that are not finite.
    """
    watch = Stopwatch()
    held_out = held_out or HeldOutViews()
    perception = (perception or Perception.published()).for_images(*capture.image_size)
    twins = (False, True) if has_rigid_twin(avatar, capture) else (False,)
    session = _Session(avatar, capture, twins, held_out, _hair_motion(avatar, capture), perception, observe, watch)
    overall = session.sums()
    segments = []
    for segment in capture.segments:
        sums, series = session.measure(segment)
        figures = [part.figures() for part in sums]
        segments.append(SegmentFigures(segment, figures[0], _second(figures), series.values))
        if segment.split == "test":
            for whole, part in zip(overall, sums, strict=True):
                whole.merge(part)
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
        cost=watch.cost(sum(part.avatar.frames for part in segments), len(capture.camera_names)),
    )


def has_rigid_twin(avatar: DrivenHead, capture: Capture) -> bool:
    """Whether holding its hair rigid makes a difference to a method, so that this is evaluated beside it."""
    segment = capture.segments[0]
    track, middle = capture.track(segment), segment.count // 2
    strands = avatar.pose(track, middle).strands
    return strands is not None and not torch.equal(strands, avatar.pose(track, middle, rigid_hair=True).strands)


@dataclass(frozen=True)
class _Session:
    """What all segments of an evaluation share.

    Attributes:
        twins: whether the hair is held rigid in what is measured side by side: in the avatar not, in its twin it is.
    """

    avatar: DrivenHead
    capture: Capture
    twins: tuple[bool, ...]
    held_out: HeldOutViews
    motion: HairMotion | None
    perception: Perception
    observe: Callable[[EvaluatedFrame], None] | None
    watch: Stopwatch

    def sums(self) -> list[FigureSums]:
        """Empty sums, of the avatar and of its rigid twin if it has one."""
        apart = self.held_out.within(self.capture.camera_names)
        return [FigureSums(apart) for _ in self.twins]

    def measure(self, segment: Segment) -> tuple[list[FigureSums], Series]:
        """Sum up one segment: the avatar, and its rigid twin if it has one."""
        capture, watch = self.capture, self.watch
        track = capture.track(segment)
        true = _compared_strands(capture, segment, self.motion)
        heads, looks = HeadTruths(capture, segment), TrueLooks(self.perception)
        sums, series = self.sums(), [Series(segment, capture.fps) for _ in self.twins]
        meters = [Meter(*own, heads, self.motion, true) for own in zip(sums, series, strict=True)]
        look_meters = [LooksMeter(looks, own) for own in sums]
        for own in sums:
            self._explain(own, segment)
        for truth in true_frames(capture, segment, evaluated_indices(segment)):
            cameras = [capture.camera(segment.frames[truth.index], name) for name in capture.camera_names]
            with watch.part("figures"):
                head = heads.frame(truth, cameras)
            with watch.part("networks"):
                look = looks.frame(truth, head.face)
            images = []
            for meter, look_meter, rigid_hair in zip(meters, look_meters, self.twins, strict=True):
                with watch.part("drawing"):
                    drawn, posed = self._draw(track, segment, truth.index, cameras, rigid_hair)
                with watch.part("figures"):
                    strands = None if posed.strands is None else _in_head(posed.strands, track, truth.index)
                    meter.add(truth, head, drawn, strands)
                with watch.part("networks"):
                    look_meter.add(look, drawn.rgb)
                images.append(drawn.rgb)
            if self.observe is not None:
                with watch.part("pictures"):
                    self.observe(EvaluatedFrame(segment, truth.index, truth.rgb, images[0], _second(images)))
        return sums, series[0]

    def protocol(self) -> dict[str, str]:
        """Say in words what was held against what."""
        capture, motion, perception = self.capture, self.motion, self.perception
        width, height = capture.image_size
        return {
            "capture": capture.name,
            "drive": "self-reenactment: each segment's tracked head pose and expression, never its images",
            "frames": f"every frame of test segments, one in {TRAINING_STRIDE} of training segments; "
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
            "networks": perception.description
            if perception.distance is not None
            else f"none: {perception.description}",
        }

    def _draw(
        self, track: HeadTrack, segment: Segment, index: int, cameras: Sequence[Camera], rigid_hair: bool
    ) -> tuple[Drawn, Any]:
        posed = self.avatar.pose(track, index, rigid_hair=rigid_hair)
        points = posed.means if posed.strands is None else posed.strands
        rendered = self.avatar.render(posed, [camera.to(points.device) for camera in cameras])
        hair, body = rendered.hair, getattr(rendered, "body", None)
        _require_finite(segment, index, points, rendered.rgb, *(() if hair is None else (hair,)))
        on_cpu = [None if coverage is None else coverage.cpu() for coverage in (hair, body)]
        return Drawn(rendered.rgb.cpu().clamp(0.0, 1.0), *on_cpu), posed

    def _explain(self, sums: FigureSums, segment: Segment) -> None:
        """Say what will be missing from a segment's figures."""
        if segment.split == "train":
            sums.explain("only every few frames of a training segment are evaluated", *TEMPORAL_FIGURES)
        if self.motion is None:
            without = "the capture holds no true strands"
            sums.explain(without if self.capture.ground_truth(segment) is None else "the method has no strands", MOTION)
        if sums.held_out is not None:
            sums.held_out.explain("it is of no view", MOTION)


def _hair_motion(avatar: DrivenHead, capture: Capture) -> HairMotion | None:
    """What compares the avatar's strands with the true ones; None where either has none."""
    first = capture.segments[0]
    true = true_strands(capture, first)
    if true is None:
        return None
    track = capture.track(first)
    rest = avatar.pose(track, 0, rigid_hair=True).strands
    if rest is None:
        return None
    _require_finite(first, 0, rest)
    return HairMotion(_in_head(rest, track, 0), true[0])


def _compared_strands(capture: Capture, segment: Segment, motion: HairMotion | None) -> Float[Tensor, "f m p 3"] | None:
    """A segment's true strands, if they are compared with the avatar's."""
    strands = None if motion is None else true_strands(capture, segment)
    if motion is not None and strands is not None and strands.shape[1:3] != (motion.true_strands, motion.true_points):
        raise DynhairError(
            f"'{segment.name}' has {strands.shape[1]} true strands of {strands.shape[2]} points",
            path=capture.path,
            expected=f"the {motion.true_strands} of {motion.true_points} points that the first segment has",
        )
    return strands


def _second(parts: Sequence[_Part]) -> _Part | None:
    """The rigid twin's part, if there is one."""
    return parts[1] if len(parts) > 1 else None


def _in_head(strands: Float[Tensor, "n l 3"], track: HeadTrack, index: int) -> Float[Tensor, "n l 3"]:
    rotation, translation = torch.from_numpy(track.rotations[index]), torch.from_numpy(track.translations[index])
    return to_head_frame(strands.cpu().double(), rotation, translation)


def _require_finite(segment: Segment, index: int, *tensors: Tensor) -> None:
    if not all(tensor.isfinite().all() for tensor in tensors):
        raise DynhairError(
            f"the avatar's strands or images are not finite in frame {index} of '{segment.name}'",
            mend="take an earlier checkpoint of its training",
        )
