"""How the person of a capture was recorded, and how that of an avatar was."""

from __future__ import annotations

from pathlib import Path

from dynhair.avatar import Recording, head_pose
from dynhair.avatar.model_folder import DESCRIPTION
from dynhair.avatar.recording import recording_in
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.storage import read_json
from dynhair.training.frames import rest_frame, training_cameras
from dynhair.training.run import avatar_folder, trained_capture


def capture_recording(capture: Capture) -> Recording:
    """What an avatar keeps of a capture."""
    segment, index = rest_frame(capture)
    (frontal,) = training_cameras(capture, 1)
    return Recording(
        fps=float(capture.fps),
        gravity=capture.gravity,
        rest=head_pose(capture.track(segment), index),
        camera=capture.camera(segment.start + index, frontal),
    )


def recording_of(path: Path | str) -> Recording:
    """How the person of an avatar was recorded, as the avatar says; an older one's is read from its training capture.

    Args:
        path: the avatar's folder, or that of the run that made it.

    Raises:
        DynhairError: the avatar does not say, and its capture is not known or no longer there.
    """
    path = Path(path)
    description = avatar_folder(path) / DESCRIPTION
    try:
        known = recording_in(read_json(description))
    except (KeyError, TypeError, ValueError) as error:
        raise DynhairError(f"`recording` is damaged ({error})", path=description) from None
    if known is not None:
        return known
    try:
        return capture_recording(Capture.open(trained_capture(path)))
    except DynhairError as error:
        raise DynhairError(
            f"the avatar does not say how the person was recorded, and its capture cannot be asked ({error.message})",
            path=path,
            expected=f"a `recording` in {DESCRIPTION}, or the capture that the avatar's run names",
            mend="bring the capture back to where it was, or train the avatar again",
        ) from error
