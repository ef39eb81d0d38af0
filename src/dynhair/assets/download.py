"""One download with a progress bar, and the check of a checksum."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

TIMEOUT = 20
"""Seconds without an answer after which a server counts as unreachable."""


class SourceError(Exception):
    """A source cannot give the file; the next one is tried."""


def download(url: str, target: Path) -> None:
    """Download ``url`` to ``target``, with a progress bar on the standard error.

    Raises:
        SourceError: no connection, or an answer that is no success.
    """
    from pooch import HTTPDownloader
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        address = urlsplit(url)
        description = f"{PurePosixPath(address.path).name[:40]} from {address.hostname}"
        bar: Any = _Bar(progress, progress.add_task(description, total=None))  # pooch's annotation knows a bool only
        # a server that compresses on the way would make the length wrong, and might unpack an archive
        headers = {"Accept-Encoding": "identity"}
        downloader = HTTPDownloader(bar, chunk_size=1 << 18, timeout=TIMEOUT, headers=headers)
        try:
            downloader(url, str(target), None)
        except (OSError, ValueError) as error:  # requests' errors are of both kinds
            raise SourceError(_reason(error)) from error


def verify(path: Path, sha256: str) -> None:
    """Check a file's SHA-256.

    Raises:
        SourceError: it is another.
    """
    found = file_sha256(path)
    if found != sha256:
        raise SourceError(f"has SHA-256 {found}, expected {sha256}")


def file_sha256(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal."""
    from pooch import file_hash

    return file_hash(str(path), alg="sha256")


def _reason(error: Exception) -> str:
    """What lies below the layers of the HTTP libraries, in one line."""
    cause = error.args[0] if error.args and isinstance(error.args[0], Exception) else error
    return str(getattr(cause, "reason", cause)) or type(error).__name__


@dataclass
class _Bar:
    """What pooch asks of a progress bar, drawn by rich."""

    progress: Progress
    task: TaskID

    @property
    def total(self) -> float | None:
        return self.progress.tasks[self.task].total

    @total.setter
    def total(self, size: int) -> None:
        self.progress.update(self.task, total=size or None)

    def update(self, size: int) -> None:
        self.progress.advance(self.task, size)

    def reset(self) -> None:
        self.progress.reset(self.task)

    def close(self) -> None:
        self.progress.stop_task(self.task)
