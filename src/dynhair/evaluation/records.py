"""What an evaluation yields: images while it runs, and figures when it is done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from torch import Tensor

from dynhair.capture import Segment
from dynhair.evaluation.cost import Cost
from dynhair.evaluation.definitions import DEFINITIONS
from dynhair.evaluation.figures import Figures
from dynhair.evaluation.held_out import HeldOutViews


@dataclass(frozen=True)
class EvaluatedFrame:
    """One frame's images in [0, 1], all views.

    Attributes:
        segment: of the capture.
        index: the frame's place in its segment.
        truth: the capture's images.
        avatar: the avatar's.
        rigid: those of the avatar with its hair held rigid; None for a method that has no rigid twin.
    """

    segment: Segment
    index: int
    truth: Float[Tensor, "v h w 3"]
    avatar: Float[Tensor, "v h w 3"]
    rigid: Float[Tensor, "v h w 3"] | None


@dataclass(frozen=True)
class ReenactedFrame:
    """One frame, each head seen by the camera that looks it most squarely in the face at rest.

    Attributes:
        segment: of the driver.
        index: the frame's place in it.
        driver: its image, in [0, 1].
        avatar: that of the avatar, by one of its own cameras.
    """

    segment: Segment
    index: int
    driver: Float[Tensor, "h w 3"]
    avatar: Float[Tensor, "y x 3"]


@dataclass(frozen=True)
class SegmentFigures:
    """The figures of one segment.

    Attributes:
        segment: of the capture.
        avatar: of the avatar.
        rigid: of the avatar with its hair held rigid; None without a rigid twin.
        series: figures of the avatar over time, by name.
    """

    segment: Segment
    avatar: Figures
    rigid: Figures | None
    series: Mapping[str, Float32[np.ndarray, " f"]]


@dataclass(frozen=True)
class Evaluation:
    """Figures over all test segments together, and over each segment.

    Attributes:
        avatar: of the avatar, over the images of all test segments.
        rigid: of the avatar with its hair held rigid; None for a method that has no rigid twin.
        segments: the same for each segment, in the capture's order.
        held_out: of the avatar and its rigid twin over the views held out alone; None where there are none.
        held_out_views: which these are.
        protocol: what was held against what, in words.
        image_size: width and height of the images, pixels.
        cost: how long it took.
    """

    avatar: Figures
    rigid: Figures | None
    segments: tuple[SegmentFigures, ...]
    held_out: tuple[Figures, Figures | None] | None
    held_out_views: HeldOutViews
    protocol: dict[str, str]
    image_size: tuple[int, int]
    cost: Cost

    def to_json(self) -> dict[str, Any]:
        """Lay out the overall figures by name, and beside them segments, rigid hair, protocol and definitions."""
        rigid = None
        if self.rigid is not None:
            parts = {s.segment.name: s.rigid for s in self.segments if s.rigid is not None}
            rigid = {**self.rigid.to_json(), "segments": self._segments_json(parts)}
        return {
            **self.avatar.to_json(),
            "segments": self._segments_json({s.segment.name: s.avatar for s in self.segments}),
            "rigid": rigid,
            "held_out_views": self._held_out_json(),
            "cost": self.cost.to_json(),
            "protocol": self.protocol,
            "image_size": list(self.image_size),
            "definitions": dict(DEFINITIONS),
        }

    def _segments_json(self, figures: Mapping[str, Figures]) -> dict[str, Any]:
        splits = {part.segment.name: part.segment.split for part in self.segments}
        return {name: {"split": splits[name], **part.to_json()} for name, part in figures.items()}

    def _held_out_json(self) -> dict[str, Any]:
        if self.held_out is None:
            return {"views": [], "reason": self.held_out_views.reason}
        avatar, rigid = self.held_out
        return {
            "views": list(self.held_out_views.names),
            **avatar.to_json(),
            "rigid": None if rigid is None else rigid.to_json(),
        }
