"""What a capture says of the head in each frame, worked out once for all that is held against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor

from dynhair.camera import Camera
from dynhair.capture import Capture, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.face import FaceRegion, face_region
from dynhair.evaluation.figures import FACE_FIGURES, LPIPS_FIGURES, TORSO_FIGURES
from dynhair.evaluation.perception import PERCEPTION_STRIDE, Perception, Seen
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
        seen: what a network sees in the images.
    """

    face: FaceRegion | None
    band: Bool[Tensor, "v h w"] | None
    torso: Bool[Tensor, "v h w"] | None
    torso_motion: Float[Tensor, "v h w"] | None
    seen: Seen | None


class HeadTruths:
    """The truth of one segment, taken frame by frame from its first.

    Args:
        capture: what is evaluated against.
        segment: of the capture.
        perception: for LPIPS.

    Attributes:
        missing: why figures cannot be measured, by name.
        perception: as given.
        torso: where it is; None where that is not known.
    """

    def __init__(self, capture: Capture, segment: Segment, perception: Perception) -> None:
        self.missing: dict[str, str] = {}
        self.perception = perception
        self.torso: Torso | None = None
        self._capture, self._segment = capture, segment
        self._first: TorsoMotion | None = None
        self._frames = 0
        cameras = [capture.camera(segment.start, name) for name in capture.camera_names]
        if perception.distance is None:
            self._leave_out(LPIPS_FIGURES, perception.description)
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
        looked_at = self.perception.distance is not None and self._frames % PERCEPTION_STRIDE == 0
        self._frames += 1
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
            seen=self.perception.see(truth.rgb, face) if looked_at else None,
        )

    def _leave_out(self, names: Sequence[str], reason: str) -> None:
        self.missing.update({name: reason for name in names if name not in self.missing})
