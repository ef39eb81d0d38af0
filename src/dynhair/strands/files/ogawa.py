"""Ogawa, the container of Alembic files: reading, first sample only.

Own reader: Alembic's own Python bindings are in no package index, and the repackaged ones bring a hundred megabytes for
what is a tree of blocks. Little endian throughout:

- header: "Ogawa", 0xff once the file is complete, two bytes of version, uint64 place of the root group;
- group: uint64 number of entries, and for each its uint64 place, the highest bit set if it is data, 0 if empty;
- data: uint64 number of bytes, and these.

The root holds two versions, the topmost object, the archive's metadata, time samplings, and metadata by index. An
object's group holds its properties, its children and their headers; a compound property's group holds its properties
and their headers; another property's group holds its samples: a digest of 16 bytes and the values, followed, for
arrays, by their dimensions.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

MAGIC = b"Ogawa"
COMPLETE = 0xFF
HDF5_MAGIC = b"\x89HDF"

IS_DATA = 1 << 63
DIGEST = 16
OWN_METADATA = 0xFF
_TOP, _INDEXED_METADATA = 2, 5  # entries of the root
# Strings, which come after these, are not read.
TYPES = ("?", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")


class Object:
    """One object of the hierarchy.

    Attributes:
        name: of the object.
        schema: what it is, such as ``AbcGeom_Curve_v2``.
        properties: its properties.
    """

    def __init__(self, archive: _Archive, entry: int, name: str, metadata: str) -> None:
        self._archive, self._entries = archive, archive.open(entry)
        self.name = name
        schemas = [pair.removeprefix("schema=") for pair in metadata.split(";") if pair.startswith("schema=")]
        self.schema = schemas[0] if schemas else ""
        self.properties = Compound(archive, self._entries[0] if self._entries else 0)

    def children(self) -> Iterator[Object]:
        """The objects below it."""
        if len(self._entries) < 2:
            return
        headers = self._archive.data(self._entries[-1])[: -2 * DIGEST]
        place, index = 0, 1
        while place < len(headers):
            name, place = _text(headers, place, "<I")
            metadata, place = self._archive.metadata(headers, place + 1, headers[place], "<I")
            yield Object(self._archive, self._entries[index], name, metadata)
            index += 1


class Compound:
    """Properties by name.

    Raises:
        KeyError: there is no property of that name, or not of that kind.
    """

    def __init__(self, archive: _Archive, entry: int) -> None:
        self._archive = archive
        entries = archive.group(entry)
        self._found: dict[str, tuple[np.dtype | None, int, int]] = {}
        headers = archive.data(entries[-1]) if entries else b""
        place, index = 0, 0
        while place < len(headers):
            (info,) = struct.unpack_from("<I", headers, place)
            place += 4
            size = ("<B", "<H", "<I")[info >> 2 & 3]
            is_compound, kind, extent = info & 3 == 0, info >> 4 & 15, info >> 12 & 255
            if not is_compound:
                # numbers of the samples, of the first and last that differ, and of the time sampling
                place += struct.calcsize(size) * (1 + 2 * (info >> 9 & 1) + (info >> 8 & 1))
            name, place = _text(headers, place, size)
            _, place = archive.metadata(headers, place, info >> 20 & 255, size)
            if is_compound:
                self._found[name] = None, 0, entries[index]
            elif kind < len(TYPES):
                self._found[name] = np.dtype(TYPES[kind]), extent, entries[index]
            index += 1

    def __contains__(self, name: str) -> bool:
        return name in self._found

    def compound(self, name: str) -> Compound:
        """A compound property."""
        dtype, _, entry = self._found[name]
        if dtype is not None:
            raise KeyError(name)
        return Compound(self._archive, entry)

    def is_compound(self, name: str) -> bool:
        """Whether that property is a compound one."""
        return self._found[name][0] is None

    def first(self, name: str) -> np.ndarray:
        """The first sample of a scalar or array property: rows of as many numbers as one value has; none if empty."""
        dtype, extent, entry = self._found[name]
        if dtype is None:
            raise KeyError(name)
        samples = self._archive.group(entry)
        values = self._archive.data(samples[0])[DIGEST:] if samples else b""
        return np.frombuffer(values, dtype).reshape(-1, extent)


def open_archive(content: bytes) -> Object:
    """The topmost object of an archive.

    Raises:
        ValueError: it is no complete Ogawa archive. So do all of an object's methods, or LookupError or struct.error,
            if the archive is damaged.
    """
    archive = _Archive(content)
    return Object(archive, archive.root[_TOP], "", "")


class _Archive:
    def __init__(self, content: bytes) -> None:
        self._content = content
        if content[:5] != MAGIC:
            raise ValueError(f"it starts with {content[:5]!r}, not with {MAGIC!r}")
        if content[5] != COMPLETE:
            raise ValueError("its writer did not finish it")
        self._opened = set[int]()
        self.root = self.group(struct.unpack_from("<Q", content, 8)[0])
        indexed, place = self.data(self.root[_INDEXED_METADATA]), 0
        self._indexed = [""]
        while place < len(indexed):
            text, place = _text(indexed, place, "<B")
            self._indexed.append(text)

    def open(self, entry: int) -> tuple[int, ...]:
        """An object's group, which no other object can have."""
        if entry and entry in self._opened:
            raise ValueError(f"two objects are at byte {entry}")
        self._opened.add(entry)
        return self.group(entry)

    def group(self, entry: int) -> tuple[int, ...]:
        if not entry:
            return ()
        if entry > len(self._content):
            raise ValueError(f"a group is announced at byte {entry}")
        (count,) = struct.unpack_from("<Q", self._content, entry)
        if count > (len(self._content) - entry) // 8:
            raise ValueError(f"{count} entries are announced at byte {entry}")
        return struct.unpack_from(f"<{count}Q", self._content, entry + 8)

    def data(self, entry: int) -> bytes:
        place = entry & ~IS_DATA
        if not place:
            return b""
        (size,) = struct.unpack_from("<Q", self._content, place)
        if not entry & IS_DATA or size > len(self._content) - place - 8:
            raise ValueError(f"{size} bytes are announced at byte {place}")
        return self._content[place + 8 : place + 8 + size]

    def metadata(self, headers: bytes, place: int, index: int, size: str) -> tuple[str, int]:
        """Metadata by index, or as it stands in a header; and where the header goes on."""
        return _text(headers, place, size) if index == OWN_METADATA else (self._indexed[index], place)


def _text(buffer: bytes, place: int, size: str) -> tuple[str, int]:
    (length,) = struct.unpack_from(size, buffer, place)
    start = place + struct.calcsize(size)
    if start + length > len(buffer):
        raise ValueError(f"{length} characters are announced")
    return buffer[start : start + length].decode("utf-8", "replace"), start + length
