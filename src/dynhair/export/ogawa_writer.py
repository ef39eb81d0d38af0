"""Ogawa, the container of Alembic files: writing. :mod:`dynhair.strands.files.ogawa` says how it is laid out.

Samples are written when they come and forgotten; only where they lie is kept, so that a file may be larger than memory.
What is equal is stored once.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from dynhair.strands.files.ogawa import COMPLETE, DIGEST, IS_DATA, MAGIC, TYPES

LIBRARY_VERSION = 10803
"""Of Alembic's own library, 1.8.3, as which the file is laid out; readers tell older layouts by it."""

_FILE_VERSION = b"\0\1"
_ROOT_PLACE = len(MAGIC) + 1 + len(_FILE_VERSION)
_MOST_METADATA = 254  # strings that have an index; the empty one is the first
_CONSTANT, _TIMED = 0, 1  # time samplings
_COMPOUND, _SCALAR, _ARRAY = 0, 1, 2
_OF_ONE_VALUE, _HAS_TIMES, _HAS_CHANGES, _SAME_SIZE, _IS_CONSTANT = 1, 1 << 8, 1 << 9, 1 << 10, 1 << 11
_SIZES = ("<B", "<H", "<I")


class Blocks:
    """Groups and data, appended to a file.

    Args:
        file: open for writing, empty.

    Attributes:
        metadata: all there are, by their indices.
        most_samples: of any property.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._known: dict[bytes, int] = {}
        self.metadata: dict[str, int] = {"": 0}
        self.most_samples = 1
        file.write(MAGIC + b"\0" + _FILE_VERSION + bytes(8))
        self._place = file.tell()

    def data(self, *parts: bytes) -> int:
        """Append data; the entry for it in a group."""
        size = sum(len(part) for part in parts)
        return IS_DATA | (self._append(struct.pack("<Q", size), *parts) if size else 0)

    def group(self, entries: Sequence[int]) -> int:
        """Append a group; the entry for it in another."""
        return self._append(struct.pack(f"<{len(entries) + 1}Q", len(entries), *entries)) if entries else 0

    def sample(self, values: np.ndarray) -> tuple[bytes, int]:
        """Append a sample unless there is an equal one already: its digest, and the entry for it in a group.

        Readers know equal samples by their digests. Alembic's own are MurmurHash3's; any serve.
        """
        content = values.tobytes()
        digest = hashlib.blake2b(content, digest_size=DIGEST).digest()
        if digest not in self._known:
            self._known[digest] = self.data(digest, content) if content else IS_DATA
        return digest, self._known[digest]

    def index(self, metadata: str) -> int:
        """Where metadata stand in the list of all."""
        assert len(metadata) < 256
        assert len(self.metadata) <= _MOST_METADATA
        return self.metadata.setdefault(metadata, len(self.metadata))

    def finish(self, root: int) -> None:
        """Say where the root is, and that the file is complete."""
        self._file.seek(_ROOT_PLACE)
        self._file.write(struct.pack("<Q", root))
        self._file.seek(len(MAGIC))
        self._file.write(bytes([COMPLETE]))

    def _append(self, *parts: bytes) -> int:
        place = self._place
        for part in parts:
            self._file.write(part)
            self._place += len(part)
        return place


class Samples:
    """A scalar or array property: what it is worth at one time after the other.

    Runs of equal samples at the beginning and the end are stored once.

    Args:
        blocks: of the file.
        name: of the property.
        kind: type of the numbers, one of :data:`~dynhair.strands.files.ogawa.TYPES`.
        extent: numbers of one value.
        metadata: of the property.
        is_array: whether a sample has any number of values, or one.
        times: whether it follows the archive's time sampling.
    """

    def __init__(
        self, blocks: Blocks, name: str, kind: str, extent: int, metadata: str, *, is_array: bool, times: bool
    ) -> None:
        self.name = name
        self._blocks, self._kind, self._extent, self._metadata = blocks, kind, extent, metadata
        self._is_array, self._times = is_array, times
        self._sizes = set[int]()
        self._count, self._first, self._last = (
            0,
            0,
            0,
        )  # samples; the first and the last that differ from the one before
        self._stored: list[tuple[bytes, int]] = []

    def add(self, values: np.ndarray) -> None:
        """Append a sample.

        Args:
            values: rows of numbers, or numbers if the extent is 1.
        """
        rows = values.reshape(-1, self._extent).astype(self._kind, copy=False)
        assert self._is_array or len(rows) == 1
        self._sizes.add(len(rows))
        found = self._blocks.sample(rows)
        if not self._stored or found != self._stored[-1]:
            self._first = self._first or self._count
            self._stored += [self._stored[-1]] * (self._count - self._last - 1) if self._last else []
            self._stored.append(found)
            self._last = self._count
        self._count += 1

    def close(self) -> tuple[bytes, int, bytes]:
        """The property's header, the entry for it in its compound's group, and a digest of it all."""
        self._blocks.most_samples = max(self._blocks.most_samples, self._last and self._count)
        entries = [entry for _, entry in self._stored]
        if self._is_array:
            # dimensions follow; of a plain list there are none
            entries = [entry for place in entries for entry in (place, IS_DATA)]
        header = self._header()
        return header, self._blocks.group(entries), _digest(header, *(digest for digest, _ in self._stored))

    def _header(self) -> bytes:
        info = TYPES.index(self._kind) << 4 | self._extent << 12
        info |= (_ARRAY | _OF_ONE_VALUE * (self._sizes == {1})) if self._is_array else _SCALAR
        numbers = [self._count]
        if not self._last:
            info |= _IS_CONSTANT
        elif (self._first, self._last) != (1, self._count - 1):
            info |= _HAS_CHANGES
            numbers += [self._first, self._last]
        if self._times:
            info |= _HAS_TIMES
            numbers.append(_TIMED)
        info |= _SAME_SIZE * (len(self._sizes) <= 1)
        return _property_header(info, self.name, self._blocks.index(self._metadata), numbers)


class Properties:
    """A compound property: properties by name."""

    def __init__(self, blocks: Blocks, name: str = "", metadata: str = "") -> None:
        self.name = name
        self._blocks, self._metadata = blocks, metadata
        self._members: list[Samples | Properties] = []

    def compound(self, name: str, metadata: str = "") -> Properties:
        """A compound property within it."""
        self._members.append(member := Properties(self._blocks, name, metadata))
        return member

    def scalar(self, name: str, kind: str, extent: int = 1, metadata: str = "", *, times: bool = False) -> Samples:
        """A property of one value a sample."""
        self._members.append(member := Samples(self._blocks, name, kind, extent, metadata, is_array=False, times=times))
        return member

    def array(self, name: str, kind: str, extent: int = 1, metadata: str = "", *, times: bool = False) -> Samples:
        """A property of any number of values a sample."""
        self._members.append(member := Samples(self._blocks, name, kind, extent, metadata, is_array=True, times=times))
        return member

    def close(self) -> tuple[bytes, int, bytes]:
        """As :meth:`Samples.close`."""
        closed = [member.close() for member in self._members]
        header = _property_header(_COMPOUND, self.name, self._blocks.index(self._metadata), [])
        digest = _digest(header, *(each[2] for each in closed))
        if not closed:
            return header, 0, digest
        headers = self._blocks.data(b"".join(each[0] for each in closed))
        return header, self._blocks.group([*(each[1] for each in closed), headers]), digest


class Node:
    """An object of the hierarchy."""

    def __init__(self, blocks: Blocks, name: str = "", metadata: str = "") -> None:
        self.name = name
        self.properties = Properties(blocks)
        self._blocks, self._metadata = blocks, metadata
        self._children: list[Node] = []

    def child(self, name: str, metadata: str) -> Node:
        """An object below it."""
        self._children.append(child := Node(self._blocks, name, metadata))
        return child

    def close(self) -> tuple[int, bytes]:
        """The entry for it in the group above, and a digest of it and everything below."""
        _, properties, digest = self.properties.close()
        closed = [child.close() for child in self._children]
        below = _digest(*(each[1] for each in closed)) if closed else bytes(DIGEST)
        headers = b"".join(child.header() for child in self._children)
        entries = [properties, *(entry for entry, _ in closed), self._blocks.data(headers, digest, below)]
        return self._blocks.group(entries), _digest(digest, below)

    def header(self) -> bytes:
        """What the object above says of it."""
        name = self.name.encode()
        return struct.pack("<I", len(name)) + name + bytes([self._blocks.index(self._metadata)])


@contextmanager
def archive(path: Path, fps: float, metadata: str) -> Iterator[Node]:
    """Write an archive whose samples are at uniform steps, the first at 0 seconds.

    Args:
        path: of the file, which is overwritten.
        fps: samples a second.
        metadata: of the archive.

    Yields:
        The topmost object, to be filled.
    """
    with path.open("wb") as file:
        blocks = Blocks(file)
        top = Node(blocks)
        yield top
        entry, _ = top.close()
        versions = blocks.data(struct.pack("<i", 0)), blocks.data(struct.pack("<i", LIBRARY_VERSION))
        samplings = (1, 1.0), (blocks.most_samples, 1 / fps)
        times = b"".join(struct.pack("<IdId", most, step, 1, 0.0) for most, step in samplings)
        indexed = b"".join(bytes([len(text)]) + text.encode() for text in list(blocks.metadata)[1:])
        root = [*versions, entry, blocks.data(metadata.encode()), blocks.data(times), blocks.data(indexed)]
        blocks.finish(blocks.group(root))


def as_metadata(**pairs: str | int | float) -> str:
    """Metadata as text, sorted by their names."""
    return ";".join(f"{name}={value}" for name, value in sorted(pairs.items()))


def _property_header(info: int, name: str, index: int, numbers: list[int]) -> bytes:
    text = name.encode()
    size = next(i for i, most in enumerate((1 << 8, 1 << 16, 1 << 32)) if max(len(text), *numbers, 0) < most)
    info |= size << 2 | index << 20
    packed = b"".join(struct.pack(_SIZES[size], number) for number in (*numbers, len(text)))
    return struct.pack("<I", info) + packed + text


def _digest(*parts: bytes) -> bytes:
    return hashlib.blake2b(b"".join(parts), digest_size=DIGEST).digest()
