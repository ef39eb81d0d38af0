"""What a page saves: files as bytes."""

from __future__ import annotations

import tempfile
from pathlib import Path

from dynhair.avatar import Avatar, PosedAvatar
from dynhair.export.splats import Splats, write_splats
from dynhair.viewer.drawing import cut_out, png
from dynhair.viewer.viewpoint import Viewpoint

LEAST_HEIGHT = 1024
"""Pixels of a snapshot, however small the page is."""


def snapshot(avatar: Avatar, posed: PosedAvatar, viewpoint: Viewpoint) -> bytes:
    """A PNG file of what a page sees, on a transparent ground."""
    factor = 1 if avatar.super_resolution is None else avatar.super_resolution.factor
    return png(cut_out(avatar, posed, viewpoint.camera(max(viewpoint.canvas[1], LEAST_HEIGHT), factor)))


def splat_file(avatar: Avatar, posed: PosedAvatar) -> bytes:
    """A PLY file of the pose, as splat viewers open it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "avatar.ply"
        write_splats(path, Splats.of(avatar, posed))
        return path.read_bytes()
