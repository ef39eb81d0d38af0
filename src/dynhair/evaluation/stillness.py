"""When nothing moves: whatever changes from frame to frame then is noise, not motion."""

from __future__ import annotations

import numpy as np
import torch

from dynhair.capture import HeadTrack
from dynhair.evaluation.settling import ARM
from dynhair.motion import so3_log

STILL = 1e-4
"""Metres that a head may have moved since a motion's first frame, ``|T_t - T_0| + ARM angle(R_0^T R_t)``, to count as
still: a fraction of what a pixel shows."""


def still_frames(track: HeadTrack) -> int:
    """How many frames a motion begins with before the head moves, the first included.

    Hair is taken to be as still, as it is where a motion begins at rest.
    """
    rotations, translations = torch.from_numpy(track.rotations), track.translations
    angles = so3_log(rotations[0].mT @ rotations).norm(dim=-1).numpy()
    moved = np.linalg.norm(translations - translations[0], axis=1) + ARM * angles > STILL
    return int(moved.argmax()) if moved.any() else len(moved)
