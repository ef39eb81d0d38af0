"""Archives and assets of a few bytes."""

from __future__ import annotations

import hashlib
import io
import tarfile
import zipfile
from collections.abc import Mapping

from dynhair.assets.catalogue import Asset
from dynhair.assets.sources import Source

NETWORK = b"the weights of a network" * 100


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def asset(*sources: Source, content: bytes = NETWORK, name: str = "tiny") -> Asset:
    return Asset(name, "testing", "CC0", sha256(content), len(content), ".bin", sources)


def wheel(members: Mapping[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def tarball(members: Mapping[str, bytes], links: Mapping[str, str] | None = None) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        for name, content in members.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
        for name, target in (links or {}).items():
            entry = tarfile.TarInfo(name)
            entry.type, entry.linkname = tarfile.SYMTYPE, target
            archive.addfile(entry)
    return stream.getvalue()
