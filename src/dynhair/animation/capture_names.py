"""``CAPTURE:NAME``: something of a capture, named together with the capture's folder."""

from __future__ import annotations

from pathlib import Path


def capture_in(spec: str) -> tuple[Path, str] | None:
    """The capture's folder and the name in it; None unless there is such a folder."""
    folder, separator, name = spec.rpartition(":")
    return (Path(folder), name) if separator and Path(folder).is_dir() else None
