"""Look a file up on the Python package index that pip is configured for, by the simple repository API (PEP 503)."""

from __future__ import annotations

import ast
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urljoin, urlsplit

from dynhair.assets.download import SourceError, download

PUBLIC_INDEX = "https://pypi.org/simple"


def configured_index() -> str:
    """The address of pip's index: by its environment variables and files, or else the public one."""
    command = [sys.executable, "-m", "pip", "config", "list"]
    listing = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    settings = dict(line.split("=", 1) for line in listing.splitlines() if "=" in line)
    for key in (":env:.index-url", "download.index-url", "global.index-url"):  # pip's own precedence
        if key in settings:
            return ast.literal_eval(settings[key])
    return PUBLIC_INDEX


def file_address(index: str, project: str, filename: str, scratch: Path) -> str:
    """Find the address of a file of a project.

    Args:
        index: address of a simple repository.
        project: normalised name.
        filename: of a wheel or source archive.
        scratch: folder for the page.

    Raises:
        SourceError: the index cannot be reached, or has no such file.
    """
    url = f"{index.rstrip('/')}/{project}/"
    page = scratch / "index"
    try:
        download(url, page)
    except SourceError as error:
        raise SourceError(f"{url}: {error}") from error
    links = _Links()
    links.feed(page.read_text(encoding="utf-8", errors="replace"))
    for link in links.targets:
        if PurePosixPath(unquote(urlsplit(link).path)).name == filename:
            return urljoin(url, link)
    raise SourceError(f"{url} does not list {filename}")


class _Links(HTMLParser):
    """The targets of a page's links."""

    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "a":
            self.targets += [value for key, value in attrs if key == "href" and value]
