"""Masks without flicker."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dynhair.capture.encoding import read_mask
from dynhair.pictures import Picture
from dynhair.preprocess.cleanup import clean_masks
from dynhair.preprocess.jobs import Job
from dynhair.preprocess.sheets import tinted
from dynhair.preprocess.steps.step import Step
from dynhair.preprocess.workspace import ViewId, Workspace


class SteadyStep(Step[tuple[ViewId, ...]]):
    """Turns the raw masks of one kind into the capture's, one camera of one segment at a time.

    Args:
        workspace: with raw masks.
        kind: ``mask`` or ``hair``.
    """

    title = "Removing flicker"

    def __init__(self, workspace: Workspace, kind: str) -> None:
        super().__init__(workspace)
        self.kind = kind
        self.name = f"steady-{kind}"

    def settings(self) -> Mapping[str, Any]:
        return {}

    def jobs(self) -> Sequence[Job[tuple[ViewId, ...]]]:
        takes = [
            tuple(ViewId(frame, name) for frame in segment.frames)
            for segment in self.workspace.manifest.segments
            for name in self.workspace.manifest.camera_names
        ]
        takes += [(view,) for view in self.workspace.views if view.is_static]
        path = self.workspace.mask_path
        return [
            Job(
                views,
                tuple(path(view, self.kind, raw=True) for view in views),
                tuple(path(view, self.kind) for view in views),
            )
            for views in takes
        ]

    def worker(self) -> Callable[[tuple[ViewId, ...]], None]:
        def work(views: tuple[ViewId, ...]) -> None:
            raw = (read_mask(self.workspace.mask_path(view, self.kind, raw=True)) for view in views)
            for view, coverage in zip(views, clean_masks(raw), strict=True):
                self.workspace.write_mask(view, self.kind, coverage)

        return work

    def picture(self, view: ViewId) -> Picture:
        return tinted(self.workspace.image(view), self.workspace.mask(view, self.kind), (120, 170, 255))
