"""NVIDIA Warp, started on first use and without its notices."""

from __future__ import annotations

import functools
from types import ModuleType

from dynhair.quiet import silent_stderr


@functools.cache
def warp() -> ModuleType:
    """Import and initialise Warp: slow, so only what computes with it asks for it."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    with silent_stderr():  # it remarks that there is no CUDA driver
        wp.init()
    return wp
