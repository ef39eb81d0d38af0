"""Removing flicker from one camera's masks, without lag and without smearing what moves.

A pixel flickers if for a frame or two it leaves what the frames about it hold for possible, where a mask may have moved
by a small reach between frames. Only such pixels are changed, and no further than to the bound that they crossed: a
temporal median or mean, with or without optical flow, blurs hair whose strands cross a pixel within a frame.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8

from dynhair.errors import DynhairError

LONGEST = 2
"""Frames that a flicker may last."""
REACH = 0.03
"""Motion from one frame to the next that is never taken for flicker, of the image's longer side."""


def clean_masks(masks: Iterable[UInt8[np.ndarray, "h w"]]) -> Iterator[UInt8[np.ndarray, "h w"]]:
    """Remove flicker of one or two frames from the masks of one take.

    Minimum and maximum over the reach about a pixel bound what another frame makes of it. Coverage is raised to what
    in each window of three frames about it one of the others is sure of, and lowered to what in each one of them
    excludes: in time, an opening and a closing by three frames (the LULU smoothers of Rohwer), which keep every edge
    and every slope in place. The first and the last frame are not between others, and stay as they are.

    Args:
        masks: coverage 0 to 255, in order of time, without gaps.

    Yields:
        As many masks, in the same order.

    Raises:
        DynhairError: the masks differ in size.
    """
    window: deque[_Bounded] = deque()
    current = 0
    for mask in masks:
        if window and mask.shape != window[0].mask.shape:
            raise DynhairError(
                f"a mask of {mask.shape[1]} x {mask.shape[0]} after one of "
                f"{window[0].mask.shape[1]} x {window[0].mask.shape[0]}",
                expected="masks of one camera, all of one size",
            )
        window.append(_bounded(mask))
        if len(window) - current > LONGEST:
            yield _cleaned(window, current)
            current += 1
            if current > LONGEST:
                window.popleft()
                current -= 1
    while current < len(window):
        yield _cleaned(window, current)
        current += 1


class _Bounded(NamedTuple):
    mask: np.ndarray
    least: np.ndarray  # over the reach about each pixel
    most: np.ndarray


def _bounded(mask: np.ndarray) -> _Bounded:
    reach = max(1, round(REACH * max(mask.shape)))
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)  # separable, a disc is not
    return _Bounded(mask, np.asarray(cv2.erode(mask, square)), np.asarray(cv2.dilate(mask, square)))


def _cleaned(window: deque[_Bounded], current: int) -> np.ndarray:
    mask = window[current].mask
    if current in (0, len(window) - 1):
        return mask
    first, last = max(0, current - LONGEST), min(current, len(window) - 1 - LONGEST)
    spans = [
        [window[time] for time in range(start, start + LONGEST + 1) if time != current]
        for start in range(first, last + 1)
    ]
    least = np.minimum.reduce([np.maximum.reduce([frame.least for frame in span]) for span in spans])
    most = np.maximum.reduce([np.minimum.reduce([frame.most for frame in span]) for span in spans])
    # where a mask flickers all the time, the bounds cross, and say nothing
    return np.clip(mask, np.minimum(least, most), np.maximum(least, most))
