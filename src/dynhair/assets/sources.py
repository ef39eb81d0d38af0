"""A source of an asset: a place, and what to take from it."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from dynhair.assets.download import SourceError
from dynhair.assets.places import Place, ReadMember


@dataclass(frozen=True)
class Source:
    """One way to the file.

    Args:
        place: where to look.
        member: the file in it; or, with ``chunk_list``, the key of the file in that list.
        chunk_list: a JSON member ``{key: {"chunks": [{"hash": sha256}, ...]}}`` whose chunks, concatenated, are the
            file. Each chunk lies beside the list and is named by its SHA-256.
    """

    place: Place
    member: str
    chunk_list: str | None = None

    @property
    def address(self) -> str:
        """Where the file is, for people."""
        return self.place.address(self.member if self.chunk_list is None else self.chunk_list)

    def read(self, scratch: Path) -> bytes:
        """Get the file.

        Args:
            scratch: empty folder for what is downloaded on the way.

        Raises:
            SourceError: it cannot be had from here.
        """
        with self.place.opened(scratch) as read_member:
            if self.chunk_list is None:
                return read_member(self.member)
            return b"".join(_chunks(read_member, self.chunk_list, self.member))


def _chunks(read_member: ReadMember, chunk_list: str, key: str) -> Iterator[bytes]:
    try:
        hashes = [str(chunk["hash"]) for chunk in json.loads(read_member(chunk_list))[key]["chunks"]]
    except (ValueError, LookupError, TypeError) as error:
        raise SourceError(f"{chunk_list} does not list the chunks of {key} ({error!r})") from error
    for expected in hashes:
        if not re.fullmatch("[0-9a-f]{64}", expected):
            raise SourceError(f"{chunk_list} lists {expected!r} in the place of a SHA-256")
        chunk = read_member(str(PurePosixPath(chunk_list).with_name(expected)))
        found = hashlib.sha256(chunk).hexdigest()
        if found != expected:
            raise SourceError(f"a chunk has SHA-256 {found}, expected {expected}")
        yield chunk
