"""What a capture is made of: segments, decoded views, head tracks, the tracked mesh, ground truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64
from torch import Tensor

from dynhair.capture.expression_basis import ExpressionBasis

Split = Literal["train", "test"]


@dataclass(frozen=True)
class Segment:
    """A run of consecutive frames of one motion; temporal windows never cross its ends.

    Attributes:
        name: the motion's name, unique in the capture.
        start: id of the first frame, as in the folders' names.
        count: number of frames.
        split: ``test`` frames are held out: training never sees them.
    """

    name: str
    start: int
    count: int
    split: Split

    @property
    def frames(self) -> range:
        """The frame ids."""
        return range(self.start, self.start + self.count)


@dataclass(frozen=True)
class View:
    """One camera's picture of one frame, with its maps; all on the CPU in float32.

    Attributes:
        rgb: sRGB in [0, 1], on the capture's background.
        mask: coverage of the person in [0, 1].
        hair: coverage of visible hair in [0, 1]; None where the capture has no hair masks.
        orientation: undirected angle of the hair in [0, 1) of pi, from +x towards +y (image down);
            None where the capture has no orientation maps.
        coherence: how far the hair of a pixel agrees on that angle, in [0, 1]; None with ``orientation``.
    """

    rgb: Float[Tensor, "h w 3"]
    mask: Float[Tensor, "h w"]
    hair: Float[Tensor, "h w"] | None
    orientation: Float[Tensor, "h w"] | None
    coherence: Float[Tensor, "h w"] | None


@dataclass(frozen=True)
class HeadTrack:
    """The head's motion over consecutive frames: ``x_world = rotation @ x_head + translation``.

    Attributes:
        rotations: head-local to world.
        translations: position of the head frame's origin, metres.
        expressions: expression coefficients.
        fps: frames per second.
        gravity: gravity in the world, m/s^2.
        expression_basis: whose coefficients ``expressions`` are; None if that is not known.
    """

    rotations: Float64[np.ndarray, "f 3 3"]
    translations: Float64[np.ndarray, "f 3"]
    expressions: Float32[np.ndarray, "f e"]
    fps: float
    gravity: Float64[np.ndarray, " 3"]
    expression_basis: ExpressionBasis | None = None


@dataclass(frozen=True)
class TrackedMesh:
    """Topology of the tracked head and upper body; positions per frame are in ``Capture.vertices``.

    Attributes:
        faces: vertex indices, counter-clockwise seen from outside.
        scalp: indices of the faces that grow hair.
        follow: 0 for a vertex that moves with the body to 1 for one that moves with the head.
        landmarks: vertex indices of the iBUG-68 landmarks.
    """

    faces: Int64[np.ndarray, "f 3"]
    scalp: Int64[np.ndarray, " s"]
    follow: Float32[np.ndarray, " v"]
    landmarks: Int64[np.ndarray, " 68"]


@dataclass(frozen=True)
class GroundTruth:
    """What only a simulated capture knows. For evaluation alone: training never reads it.

    Attributes:
        strands: a fixed subset of the true strands, root first, world, metres.
    """

    strands: Float32[np.ndarray, "f n l 3"]
