"""Animatable head avatars with explicit, moving hair strands.

The public names are loaded on first use, so that ``import dynhair`` and ``dynhair --help`` stay quick.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

# Idle OpenMP threads must sleep: spinning ones slow a step down several times on a busy machine.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

if TYPE_CHECKING:
    from dynhair.avatar import Avatar, LiveAvatar, Recording
    from dynhair.capture import Capture
    from dynhair.presets import PRESETS
    from dynhair.training.trainer import train

__version__ = "0.1.0"
__all__ = ["PRESETS", "Avatar", "Capture", "LiveAvatar", "Recording", "train"]

_HOMES = {
    "Avatar": "avatar",
    "Capture": "capture",
    "LiveAvatar": "avatar",
    "PRESETS": "presets",
    "Recording": "avatar",
    "train": "training.trainer",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"dynhair.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'dynhair' has no attribute '{name}'")
