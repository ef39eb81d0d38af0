"""The recent past of a frame, as the deformer sees it."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def motion_window(conditions: Float[Tensor, "f c"], frame: int, history: int) -> Float[Tensor, "t c"]:
    """Take the conditions of frames ``frame - history`` to ``frame``, oldest first.

    Frames before the segment's first one repeat the first one: a window never crosses into another segment.

    Args:
        conditions: one segment's conditions.
        frame: index inside the segment.
        history: how many frames to look back; the window has ``history + 1``.

    Raises:
        IndexError: the frame is not in the segment.
    """
    count = len(conditions)
    if not 0 <= frame < count:
        raise IndexError(f"frame {frame} of a segment of {count} frames")
    return conditions[torch.arange(frame - history, frame + 1, device=conditions.device).clamp_min(0)]
