"""Landmarks on disk, a file for each view."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynhair.capture.arrays import read_npz
from dynhair.errors import DynhairError
from dynhair.preprocess.landmarks.blendshapes import BLENDSHAPE_NAMES
from dynhair.preprocess.landmarks.landmarker import FaceLandmarks
from dynhair.preprocess.landmarks.networks import POINTS
from dynhair.storage import atomic_file

_ARRAYS = {"points": (None, 3), "visibility": (None,), "blendshapes": (None,), "score": ()}
_LENGTHS = {"points": POINTS, "visibility": POINTS, "blendshapes": len(BLENDSHAPE_NAMES)}


def save_landmarks(path: Path | str, face: FaceLandmarks | None) -> None:
    """Write the landmarks of one view, atomically.

    Args:
        path: of the ``.npz``. It holds ``points``, ``visibility``, ``blendshapes`` and ``score``.
        face: None if the face was not found: the arrays are then empty, and the score 0.
    """
    with atomic_file(path) as temporary:
        np.savez(
            temporary,
            points=np.empty((0, 3), np.float32) if face is None else face.points.astype(np.float32),
            visibility=np.empty(0, np.float32) if face is None else face.visibility.astype(np.float32),
            blendshapes=np.empty(0, np.float32) if face is None else face.blendshapes.astype(np.float32),
            score=np.float32(0 if face is None else face.score),
        )


def load_landmarks(path: Path | str) -> FaceLandmarks | None:
    """Read the landmarks of one view; None if the face was not found there.

    Raises:
        DynhairError: the file is missing or damaged.
    """
    arrays = read_npz(Path(path), _ARRAYS)
    lengths = {name: len(arrays[name]) for name in _LENGTHS}
    if not any(lengths.values()):
        return None
    if lengths != _LENGTHS:
        raise DynhairError(
            f"holds {lengths}",
            path=path,
            expected=f"{_LENGTHS}, or none where there is no face",
            mend="delete the file and run the step again",
        )
    return FaceLandmarks(arrays["points"], arrays["visibility"], float(arrays["score"]), arrays["blendshapes"])
