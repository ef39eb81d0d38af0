"""Which of a capture's cameras training did not use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dynhair.capture import Capture
from dynhair.training.frames import training_cameras
from dynhair.training.run import Run


@dataclass(frozen=True)
class HeldOutViews:
    """Cameras that a training left out.

    Attributes:
        names: theirs; none where that cannot be said, or all were used.
        reason: why there are none.
    """

    names: tuple[str, ...] = ()
    reason: str = "nothing tells which cameras the training used"

    def within(self, names: tuple[str, ...]) -> list[bool]:
        """For each of these cameras whether it was held out."""
        return [name in self.names for name in names]


def held_out_views(run: Run | None, capture: Capture) -> HeldOutViews:
    """Tell the cameras of a capture that the training of an avatar did not use.

    Args:
        run: that trained the avatar; None where that is not known.
        capture: what the avatar is evaluated against.
    """
    if run is None:
        return HeldOutViews(reason="the avatar lies outside its run, so the cameras of its training are not known")
    if not same_folder(run.capture, capture.path):
        return HeldOutViews(reason="the avatar was trained on another capture")
    used = training_cameras(capture, run.config.training.cameras)
    unused = tuple(name for name in capture.camera_names if name not in used)
    return HeldOutViews(unused, "" if unused else f"the training used all {len(used)} cameras")


def same_folder(first: Path, second: Path) -> bool:
    """Whether two paths lead to one folder, also where it is no longer there."""
    return first.resolve() == second.resolve()
