"""What a capture says of the head in each frame, worked out once for all that is held against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.definitions import FACE_FIGURES, TORSO_FIGURES
from dynhair.evaluation.face import FaceRegion, face_region
from dynhair.evaluation.regions import boundary_band
from dynhair.evaluation.torso import Torso, TorsoMotion
from dynhair.evaluation.truth import TrueFrame


@dataclass(frozen=True)
class HeadTruth:
    """One frame; None for what is not to be had, or not asked for in this frame.

    Attributes:
        face: where the views show the face.
        band: pixels along the edge of the hair.
        torso: pixels of the torso, hair or not, both in this and in the segment's first frame.
        torso_motion: how far the torso's edges have moved since then, pixels.
    """

    face: FaceRegion | None
    band: Bool[Tensor, "v h w"] | None
    torso: Bool[Tensor, "v h w"] | None
    torso_motion: Float[Tensor, "v h w"] | None


class HeadTruths:
    """The truth of one segment, taken frame by frame from its first.

    Args:
        capture: what is evaluated against.
        segment: of the capture.

    Attributes:
        missing: why figures cannot be measured, by name.
        torso: where it is; None where that is not known.
    """

    def __init__(self, capture: Capture, segment: Segment) -> None:
        self.missing: dict[str, str] = {}
        self.torso: Torso | None = None
        self._capture, self._segment = capture, segment
        self._first: TorsoMotion | None = None
        cameras = [capture.camera(segment.start, name) for name in capture.camera_names]
        try:
            face_region(capture, segment, 0, cameras)
        except DynhairError as error:
            self._leave_out(FACE_FIGURES, f"no 3-D landmarks: {error.message}")
        try:
            self.torso = Torso(capture, segment, cameras)
        except DynhairError as error:
            self._leave_out(TORSO_FIGURES, f"no tracked torso: {error.message}")

    def frame(self, truth: TrueFrame, cameras: Sequence[Camera]) -> HeadTruth:
        """Work out the next frame that is evaluated."""
        has_face = FACE_FIGURES[0] not in self.missing
        face = face_region(self._capture, self._segment, truth.index, cameras) if has_face else None
        torso = motion = None
        if self.torso is not None:
            if self._first is None:
                self._first = TorsoMotion(self.torso, truth.rgb)
            else:
                torso = self.torso.pixels(truth.index, cameras)
                motion = self._first.distances(truth.rgb)
        return HeadTruth(
            face=face,
            band=None if truth.hair is None else boundary_band(truth.hair),
            torso=torso,
            torso_motion=motion,
        )

    def _leave_out(self, names: Sequence[str], reason: str) -> None:
        self.missing.update({name: reason for name in names if name not in self.missing})
