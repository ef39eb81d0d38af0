"""A picture of the face at its strongest expressions, the avatar's below the truth's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image

from dynhair.capture import Capture, Segment
from dynhair.errors import DynhairError
from dynhair.evaluation.face import projected_hull, square_round
from dynhair.evaluation.pictures import enlarged_picture
from dynhair.evaluation.protocol import evaluated_indices
from dynhair.evaluation.recorder import most_frontal_view
from dynhair.evaluation.records import EvaluatedFrame
from dynhair.pictures import Picture, grid
from dynhair.storage import atomic_file

MOST_COEFFICIENTS = 6
USED = 0.1
"""Share of a coefficient's range that the test motions must span, or else a training frame shows it."""

SIDE = 256
"""Pixels of a face in the picture."""

FACE_MARGIN = 0.25
"""Space round the landmarks, in sides of the least square round them."""

_LEAST_RANGE = 1e-6


@dataclass(frozen=True)
class ExpressiveFrame:
    """A frame that shows an expression.

    Attributes:
        segment: of the capture.
        index: the frame's place in it.
        coefficient: number of the coefficient that is largest there; None for the neutral frame.
        value: of that coefficient.
    """

    segment: Segment
    index: int
    coefficient: int | None = None
    value: float = 0.0


def expressive_frames(
    segments: Sequence[Segment], indices: Sequence[Sequence[int]], expressions: Sequence[Float[np.ndarray, "_ e"]]
) -> list[ExpressiveFrame]:
    """Choose the frame nearest to neutral, and for each coefficient that varies the one where it is strongest.

    Frames of test segments come first: others serve where these never use a coefficient. Of many coefficients, the
    `MOST_COEFFICIENTS` with the largest range are taken, in their order.

    Args:
        segments: that are evaluated.
        indices: each one's frames that may be chosen.
        expressions: each one's coefficients in these frames.

    Returns:
        None at all where no coefficient varies.
    """
    frames = [(segment, index) for segment, places in zip(segments, indices, strict=True) for index in places]
    values = np.concatenate(list(expressions)).astype(np.float64)
    test = np.array([segment.split == "test" for segment, _ in frames], bool)
    ranges = np.ptp(values, axis=0)
    largest = np.argsort(-ranges, kind="stable")[:MOST_COEFFICIENTS]
    chosen = [int(coefficient) for coefficient in sorted(largest) if ranges[coefficient] > _LEAST_RANGE]
    if not chosen:
        return []
    strength = (np.abs(values[:, chosen]) / ranges[chosen]).sum(axis=1)
    if test.any():
        strength[~test] = np.inf
    found = [ExpressiveFrame(*frames[int(np.argmin(strength))])]
    for coefficient in chosen:
        allowed = test if _is_used(values[test, coefficient], ranges[coefficient]) else np.ones_like(test)
        place = int(np.argmax(np.where(allowed, np.abs(values[:, coefficient]), -1.0)))
        found.append(ExpressiveFrame(*frames[place], coefficient, float(values[place, coefficient])))
    return found


class ExpressionSheet:
    """Observes an evaluation, and keeps the faces that it will show.

    Args:
        capture: what is evaluated against.
        segments: of it that are evaluated.
    """

    def __init__(self, capture: Capture, segments: Sequence[Segment]) -> None:
        self._capture = capture
        indices = [evaluated_indices(segment) for segment in segments]
        tracks = [capture.track(segment) for segment in segments]
        expressions = [track.expressions[list(places)] for track, places in zip(tracks, indices, strict=True)]
        self._chosen = expressive_frames(segments, indices, expressions)
        self._wanted = {(chosen.segment.name, chosen.index) for chosen in self._chosen}
        self._faces: dict[tuple[str, int], list[Picture]] = {}

    def __call__(self, frame: EvaluatedFrame) -> None:
        """Keep the faces of truth and avatar, if this frame is one of those shown."""
        place = (frame.segment.name, frame.index)
        if place not in self._wanted:
            return
        view = most_frontal_view(self._capture, frame.segment, frame.index)
        identity = frame.segment.frames[frame.index]
        camera = self._capture.camera(identity, self._capture.camera_names[view])
        try:
            landmarks = torch.from_numpy(self._capture.landmarks_3d(identity))
        except DynhairError:
            return  # without landmarks nobody knows where the face is
        square = square_round(projected_hull(landmarks, camera), FACE_MARGIN)
        if square is not None:
            faces = (square.crop(images[view]) for images in (frame.truth, frame.avatar))
            self._faces[place] = [enlarged_picture(face, SIDE) for face in faces]

    def write(self, out: Path) -> Path | None:
        """Write ``expressions.png`` into a folder; nothing if there is no face to show."""
        columns = [chosen for chosen in self._chosen if (chosen.segment.name, chosen.index) in self._faces]
        if not columns:
            return None
        faces = [self._faces[chosen.segment.name, chosen.index] for chosen in columns]
        sheet = grid(
            list(zip(*faces, strict=True)), ["truth", "avatar"], [_label(c, self._capture.fps) for c in columns]
        )
        path = out / "expressions.png"
        with atomic_file(path) as temporary:
            Image.fromarray(sheet).save(temporary, optimize=True)
        return path


def _is_used(values: Float[np.ndarray, " f"], whole_range: float) -> bool:
    return len(values) > 0 and bool(np.ptp(values) >= USED * whole_range)


def _label(chosen: ExpressiveFrame, fps: float) -> str:
    what = "neutral" if chosen.coefficient is None else f"coefficient {chosen.coefficient}: {chosen.value:.2f}"
    training = "" if chosen.segment.split == "test" else ", training"
    return f"{what} ({chosen.segment.name} {chosen.index / fps:.2f} s{training})"
