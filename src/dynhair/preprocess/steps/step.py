"""What a step is, and how one is run."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from dynhair.pictures import Picture
from dynhair.preprocess.jobs import Job, for_each, record_settings
from dynhair.preprocess.sheets import write_sheet
from dynhair.preprocess.workspace import ViewId, Workspace
from dynhair.progress import StageProgress

T = TypeVar("T")


class Step(ABC, Generic[T]):
    """One step of preprocessing: what it makes, from what, and how.

    Args:
        workspace: where its inputs and outputs are.
    """

    name: str
    """Of its files."""
    title: str
    """For people."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self.advance: Callable[[int, int], None] = lambda done, total: None
        """What a step of a single job calls with how much is done and how much there is."""

    @property
    def record(self) -> Path:
        """Where its settings are kept."""
        return self.workspace.folder / f"{self.name}.json"

    @property
    def sheet(self) -> Path:
        """Where its contact sheet is."""
        return self.workspace.folder / "sheets" / f"{self.name}.jpg"

    @abstractmethod
    def settings(self) -> Mapping[str, Any]:
        """Everything but its inputs that determines its outputs, as JSON holds it."""

    @abstractmethod
    def jobs(self) -> Sequence[Job[T]]:
        """All its work, done or not."""

    @abstractmethod
    def worker(self) -> Callable[[T], None]:
        """Make what does one job; called once in each thread."""

    @property
    def note(self) -> str:
        """What the page says of it."""
        return ""

    def picture(self, view: ViewId) -> Picture | None:
        """Draw what it made of one view, in the size of the view's image; None for a step without pictures."""
        del view
        return None

    def run(self, progress: StageProgress, before: Callable[[], None]) -> bool:
        """Do what is not done yet, then draw the contact sheet.

        Args:
            progress: shows a bar where there is something to do.
            before: called if there is something to do, before it is done.

        Returns:
            Whether there was something to do.
        """
        record_settings(self.record, self.settings())
        jobs = self.jobs()
        stale = [job for job in jobs if not job.is_fresh(self.record)]
        if stale:
            before()
            stage = progress.stage(self.title, len(jobs), len(jobs) - len(stale))
            self.advance = lambda done, total: stage.update(done, total=total)
            began = time.monotonic()

            def done(count: int) -> None:
                if len(jobs) > 1:  # a single job tells by itself how far it is
                    rate = (time.monotonic() - began) / count
                    stage.update(len(jobs) - len(stale) + count, f"{1000 * rate:.0f} ms each")

            for_each([job.what for job in stale], self.worker, done)
        if stale or not self.sheet.exists():
            write_sheet(self.workspace, self.sheet, self.picture)
        return bool(stale)
