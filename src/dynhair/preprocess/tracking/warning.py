"""What the user should look at after tracking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dynhair.preprocess.tracking.result import TrackingResult

_SIGNIFICANT = 4.0  # standard errors
_LARGEST_TIME_OFFSET = 0.25  # frames
_LARGEST_SHIFT = 0.04  # of the face's side

WarningKind = Literal["synchronisation", "calibration", "lost"]


@dataclass(frozen=True)
class TrackingWarning:
    """Something the user should look at.

    Attributes:
        kind: what is wrong.
        camera: index of the camera, if it is about one.
        take: index of the take, if it is about one.
        frames: counted within the take.
        text: one sentence.
    """

    kind: WarningKind
    camera: int | None
    take: int | None
    frames: range | None
    text: str


def tracking_warnings(result: TrackingResult, camera_names: Sequence[str] | None = None) -> list[TrackingWarning]:
    """What the user should look at: cameras out of sync or badly calibrated, and frames without a face.

    Args:
        result: of tracking.
        camera_names: what to call the cameras; their indices by default.
    """
    diagnostics = result.diagnostics
    names = camera_names or [str(view) for view in range(len(diagnostics.cameras))]
    worst = max(
        (float(np.linalg.norm(c.shift)) / c.face_size for c in diagnostics.cameras if c.face_size > 0), default=0
    )
    warnings = []
    for view, (name, camera) in enumerate(zip(names, diagnostics.cameras, strict=True)):
        offset, error = camera.time_offset, camera.time_offset_error
        if abs(offset) > max(_LARGEST_TIME_OFFSET, _SIGNIFICANT * error):
            late = "late" if offset > 0 else "early"
            shown = f"its frame 100 shows what frame {100 + offset:.1f} of the others does"
            text = f"camera {name} is {abs(offset):.1f} frames {late} (standard error {error:.1f}): {shown}"
            warnings.append(TrackingWarning("synchronisation", view, None, None, text))
        size = float(np.linalg.norm(camera.shift))
        # A wrong camera pushes the others off as well, but less.
        limit = max(_LARGEST_SHIFT * camera.face_size, _SIGNIFICANT * camera.shift_error, worst * camera.face_size / 2)
        if camera.face_size > 0 and size > limit:
            x, y = camera.shift
            text = f"camera {name} sees the face {size:.1f} pixels off ({x:+.1f} right, {y:+.1f} down) all the time"
            warnings.append(TrackingWarning("calibration", view, None, None, f"{text}: check its calibration"))
    for index, (track, runs) in enumerate(zip(result.takes, diagnostics.lost, strict=True)):
        for run in runs:
            frames = f"frame {run.start}" if len(run) == 1 else f"frames {run.start} to {run.stop - 1}"
            text = f"{track.name}: the face was lost in {frames}; the pose is bridged"
            warnings.append(TrackingWarning("lost", None, index, run, text))
    return warnings
