"""The head mesh of a capture, and that of an avatar."""

from __future__ import annotations

from pathlib import Path

from dynhair.avatar import Avatar, HeadMesh
from dynhair.avatar.head_mesh import HEAD_MESH
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.run import trained_capture
from dynhair.training.surface import tracked_surface


def capture_head_mesh(capture: Capture) -> HeadMesh:
    """The tracked mesh of a capture at rest, or the open head in its place.

    Raises:
        DynhairError: there is no mesh, and the rest frame's landmarks are missing or do not form a face.
    """
    surface = tracked_surface(capture)
    segment, index = rest_frame(capture)
    vertices = surface.vertices(segment.start + index)
    return HeadMesh(head_frame(capture.track(segment), index)(vertices), surface.faces)


def head_mesh_of(avatar: Avatar, path: Path) -> HeadMesh:
    """The mesh that an avatar keeps; an older one's is read from its training capture.

    Args:
        avatar: whose mesh.
        path: its folder, or that of the run that made it.

    Raises:
        DynhairError: the avatar keeps none, and its capture is not known, no longer there, or has none.
    """
    if avatar.head_mesh is not None:
        return avatar.head_mesh
    try:
        return capture_head_mesh(Capture.open(trained_capture(path), cache_bytes=0))
    except DynhairError as error:
        raise DynhairError(
            f"the avatar keeps no head mesh, and its capture cannot be asked ({error.message})",
            path=path,
            expected=f"{HEAD_MESH} in the avatar's folder, or the capture that its run names",
            mend="bring the capture back to where it was, or train the avatar again",
        ) from error
