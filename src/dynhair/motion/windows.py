"""The recent past of a frame, as the deformer sees it."""

from __future__ import annotations

from collections.abc import Sequence

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
    return motion_windows(conditions, [frame], history)[0]


def motion_windows(conditions: Float[Tensor, "f c"], frames: Sequence[int], history: int) -> Float[Tensor, "b t c"]:
    """:func:`motion_window` of several frames."""
    count = len(conditions)
    for frame in frames:
        if not 0 <= frame < count:
            raise IndexError(f"frame {frame} of a segment of {count} frames")
    last = torch.as_tensor(frames, dtype=torch.long, device=conditions.device)
    offsets = torch.arange(-history, 1, device=conditions.device)
    return conditions[(last[:, None] + offsets).clamp_min(0)]
