"""Names of something of a capture: ``CAPTURE:NAME``, and the capture that a name alone is about."""

from __future__ import annotations

from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.training.run import trained_capture


def capture_in(spec: str) -> tuple[Path, str] | None:
    """The capture's folder and the name in it; None unless there is such a folder."""
    folder, separator, name = spec.rpartition(":")
    return (Path(folder), name) if separator and Path(folder).is_dir() else None


def own_capture(avatar: Path) -> Path | None:
    """The capture that an avatar was trained on, which names alone are about; None if it is not known or gone.

    Args:
        avatar: the avatar's folder, or that of the run that made it.
    """
    try:
        capture = trained_capture(avatar)
    except DynhairError:
        return None
    return capture if capture.is_dir() else None
