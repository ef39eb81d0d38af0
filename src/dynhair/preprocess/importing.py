"""The import as the first step of preprocessing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from dynhair.capture.layout import frame_ids
from dynhair.errors import DynhairError
from dynhair.preprocess.options import ImportOptions
from dynhair.preprocess.sources import import_recording, open_recording
from dynhair.preprocess.workspace import Workspace
from dynhair.progress import StageProgress

_FRAME_FOLDERS = ("images", "cameras", "params", "landmarks")


def import_step(
    raw: Path, workspace: Workspace, options: ImportOptions, progress: StageProgress, before: Callable[[], None]
) -> tuple[str, ...]:
    """Bring a recording's pictures and cameras into the workspace, as far as they are not there.

    Frames of an earlier import that are not wanted any more are removed.

    Args:
        raw: the recording's folder.
        workspace: where they go.
        options: where the recording's cameras are, which frames, how large.
        progress: shows a bar.
        before: called if there is something to import, before it is done.

    Returns:
        What the user should know, a sentence each.

    Raises:
        DynhairError: the recording cannot be read, or the workspace's folder holds something else.
    """
    root = workspace.root
    if root.exists() and (not root.is_dir() or (any(root.iterdir()) and not workspace.folder.is_dir())):
        raise DynhairError(
            "there is something already that preprocessing did not make",
            path=root,
            expected="a new or empty folder, or one that preprocessing began",
            mend="choose another folder by --out",
        )
    recording = open_recording(raw, options.layout, options.calibration, options.fps)
    stage = None

    def update(done: int, total: int) -> None:
        nonlocal stage
        if stage is None:
            if done == total:  # everything was there before
                return
            before()
            stage = progress.stage("Importing", total, done)
        stage.update(done)

    notes = import_recording(recording, workspace, options, update)
    wanted = {frame for segment in workspace.manifest.segments for frame in segment.frames}
    for folder in (root / name for name in _FRAME_FOLDERS):
        for frame in frame_ids(folder):
            if frame not in wanted:
                shutil.rmtree(folder / f"{frame:04d}")
    return notes
