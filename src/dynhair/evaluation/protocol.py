"""Self-reenactment: a capture's own motions drive the avatar, and its images are held against the capture's.

The avatar sees each segment's tracked head pose and expression, never its images. Segments held out from training are
evaluated in every frame, the others in every few; all views always. The same avatar with its hair held rigid runs
beside it, since a figure says little without the figure that no hair motion at all would get.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.figures import DEFINITIONS, Figures, FigureSums
from dynhair.evaluation.flicker import TrueFlicker
from dynhair.evaluation.hair_motion import HairMotion, to_head_frame
from dynhair.evaluation.head_meter import Drawn
from dynhair.evaluation.head_truth import HeadTruths
from dynhair.evaluation.meter import Meter
from dynhair.evaluation.perception import Perception
from dynhair.evaluation.truth import true_frames, true_strands

TRAINING_STRIDE = 5
"""Of a training segment's frames, one in this many is evaluated."""


@runtime_checkable
class DrivenHead(Protocol):
    """What is evaluated: anything that a head track poses and cameras see, such as an `Avatar`."""

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> Any:
        """Pose by one frame of a track; the result has ``strands (n, l, 3)``, world, metres."""
        ...

    def render(self, posed: Any, cameras: Sequence[Camera]) -> Any:
        """Images from the cameras: ``rgb (v, h, w, 3)`` and the hair's coverage ``hair (v, h, w)``.

        The coverage of head and body, ``body (v, h, w)``, is measured where there is one.
        """
        ...


@dataclass(frozen=True)
class EvaluatedFrame:
    """One frame's images in [0, 1], all views.

    Attributes:
        segment: of the capture.
        index: the frame's place in its segment.
        truth: the capture's images.
        avatar: the avatar's.
        rigid: those of the avatar with its hair held rigid.
    """

    segment: Segment
    index: int
    truth: Float[Tensor, "v h w 3"]
    avatar: Float[Tensor, "v h w 3"]
    rigid: Float[Tensor, "v h w 3"]


@dataclass(frozen=True)
class SegmentFigures:
    """The figures of one segment, of the avatar and of the avatar with its hair held rigid."""

    segment: Segment
    avatar: Figures
    rigid: Figures


@dataclass(frozen=True)
class Evaluation:
    """Figures over all test segments together, and over each segment.

    Attributes:
        avatar: of the avatar, over the images of all test segments.
        rigid: of the avatar with its hair held rigid.
        segments: the same for each segment, in the capture's order.
        protocol: what was held against what, in words.
    """

    avatar: Figures
    rigid: Figures
    segments: tuple[SegmentFigures, ...]
    protocol: dict[str, str]

    def to_json(self) -> dict[str, Any]:
        """Lay out the overall figures by name, and beside them segments, rigid hair, protocol and definitions."""
        return {
            **self.avatar.to_json(),
            "segments": {s.segment.name: {"split": s.segment.split, **s.avatar.to_json()} for s in self.segments},
            "rigid": {
                **self.rigid.to_json(),
                "segments": {s.segment.name: {"split": s.segment.split, **s.rigid.to_json()} for s in self.segments},
            },
            "protocol": self.protocol,
            "definitions": dict(DEFINITIONS),
        }


def evaluated_indices(segment: Segment) -> range:
    """Places in the segment that are evaluated: all of a test segment, every `TRAINING_STRIDE`-th of a training one."""
    return range(0, segment.count, 1 if segment.split == "test" else TRAINING_STRIDE)


@torch.no_grad()
def evaluate_avatar(
    avatar: DrivenHead,
    capture: Capture,
    *,
    perception: Perception | None = None,
    observe: Callable[[EvaluatedFrame], None] | None = None,
) -> Evaluation:
    """Drive the avatar by each segment's track and hold it against the capture, in constant memory.

    Hair rests in the capture's first frame: displacements of the true strands count from there.

    Args:
        avatar: what is evaluated.
        capture: the truth. Its true strands, where it has them, serve the figure of hair motion alone.
        perception: for LPIPS; the published network when left out.
        observe: called with each frame's images once they are measured.

    Raises:
        DynhairError: the avatar renders values that are not finite.
    """
    first = capture.segments[0]
    strands_at_rest = true_strands(capture, first)
    motion = None
    if strands_at_rest is not None:
        track = capture.track(first)
        rest = avatar.pose(track, 0, rigid_hair=True).strands
        _require_finite(first, 0, rest)
        motion = HairMotion(_in_head(rest, track, 0), strands_at_rest[0])

    perception = (perception or Perception.published()).for_images(*capture.image_size)
    overall, overall_rigid = FigureSums(), FigureSums()
    segments = []
    for segment in capture.segments:
        sums, sums_rigid = _measure_segment(avatar, capture, segment, motion, perception, observe)
        segments.append(SegmentFigures(segment, sums.figures(), sums_rigid.figures()))
        if segment.split == "test":
            overall.merge(sums)
            overall_rigid.merge(sums_rigid)
    protocol = _protocol(capture, motion, perception)
    if not overall.frames:
        nothing = Figures.unmeasured("the capture has no test segment")
        return Evaluation(nothing, nothing, tuple(segments), protocol)
    return Evaluation(overall.figures(), overall_rigid.figures(), tuple(segments), protocol)


def _measure_segment(
    avatar: DrivenHead,
    capture: Capture,
    segment: Segment,
    motion: HairMotion | None,
    perception: Perception,
    observe: Callable[[EvaluatedFrame], None] | None,
) -> tuple[FigureSums, FigureSums]:
    """Sum up one segment: the avatar, and the avatar with its hair held rigid."""
    track = capture.track(segment)
    strands = None if motion is None else true_strands(capture, segment)
    if motion is not None and strands is not None and strands.shape[1:3] != (motion.true_strands, motion.true_points):
        raise DynhairError(
            f"'{segment.name}' has {strands.shape[1]} true strands of {strands.shape[2]} points",
            path=capture.path,
            expected=f"the {motion.true_strands} of {motion.true_points} points that the first segment has",
        )
    heads = HeadTruths(capture, segment, perception)
    flicker = TrueFlicker(perception)
    meters = (Meter(segment, heads, motion, strands), Meter(segment, heads, motion, strands))
    for truth in true_frames(capture, segment, evaluated_indices(segment)):
        cameras = [capture.camera(segment.frames[truth.index], name) for name in capture.camera_names]
        head, change = heads.frame(truth, cameras), flicker.change(truth)
        images = []
        for meter, rigid_hair in zip(meters, (False, True), strict=True):
            posed = avatar.pose(track, truth.index, rigid_hair=rigid_hair)
            rendered = avatar.render(posed, [camera.to(posed.strands.device) for camera in cameras])
            body = getattr(rendered, "body", None)
            _require_finite(segment, truth.index, posed.strands, rendered.rgb, rendered.hair)
            drawn = Drawn(rendered.rgb.cpu().clamp(0.0, 1.0), rendered.hair.cpu(), None if body is None else body.cpu())
            images.append(drawn.rgb)
            meter.add(truth, head, change, drawn, _in_head(posed.strands, track, truth.index))
        if observe is not None:
            observe(EvaluatedFrame(segment, truth.index, truth.rgb, *images))
    return meters[0].sums, meters[1].sums


def _in_head(strands: Float[Tensor, "n l 3"], track: HeadTrack, index: int) -> Float[Tensor, "n l 3"]:
    rotation, translation = torch.from_numpy(track.rotations[index]), torch.from_numpy(track.translations[index])
    return to_head_frame(strands.cpu().double(), rotation, translation)


def _require_finite(segment: Segment, index: int, *tensors: Tensor) -> None:
    if not all(tensor.isfinite().all() for tensor in tensors):
        raise DynhairError(
            f"the avatar's strands or images are not finite in frame {index} of '{segment.name}'",
            mend="take an earlier checkpoint of its training",
        )


def _protocol(capture: Capture, motion: HairMotion | None, perception: Perception) -> dict[str, str]:
    width, height = capture.image_size
    return {
        "capture": capture.name,
        "drive": "self-reenactment: each segment's tracked head pose and expression, never its images",
        "frames": f"every frame of test segments, one in {TRAINING_STRIDE} of training segments; "
        "the figures outside `segments` are over the test segments together",
        "views": f"all {len(capture.camera_names)}, {width}x{height} pixels: {', '.join(capture.camera_names)}",
        "rigid": "the same avatar, its hair held in its canonical shape and moved with the head",
        "hair_masks": "the hair coverage stored in the capture for the truth, rendered hair coverage for the avatar",
        "true_strands": "none"
        if motion is None
        else f"{motion.true_strands} of {motion.true_points} points from the capture, at rest in its first frame",
        "networks": perception.description if perception.distance is not None else f"none: {perception.description}",
    }
