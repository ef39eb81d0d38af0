"""Every sample of every property of an Alembic file, read from its bytes alone, by none of the project's code."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

NUMBERS = ("?", "u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8")
DATA = 1 << 63


@dataclass
class Property:
    samples: list[np.ndarray]
    metadata: dict[str, str]
    times: list[float]
    stored: int


class Reader:
    """Properties by paths such as ``/groom/strands/.geom/P``; schemas of objects and compounds by theirs."""

    def __init__(self, path: Path) -> None:
        self.content = path.read_bytes()
        assert self.content[:8] == b"Ogawa\xff\0\1"
        root = self.group(struct.unpack_from("<Q", self.content, 8)[0])
        assert struct.unpack("<i", self.data(root[0])) == (0,)
        assert struct.unpack("<i", self.data(root[1]))[0] >= 10800
        self.description = self.pairs(self.data(root[3]).decode())
        self.samplings: list[tuple[int, float, float]] = []
        times = self.data(root[4])
        for place in range(0, len(times), 24):
            most, step, count, first = struct.unpack_from("<IdId", times, place)
            assert count == 1
            self.samplings.append((most, step, first))
        self.indexed, place, texts = [""], 0, self.data(root[5])
        while place < len(texts):
            self.indexed.append(texts[place + 1 : place + 1 + texts[place]].decode())
            place += 1 + texts[place]
        self.properties: dict[str, Property] = {}
        self.schemas: dict[str, dict[str, str]] = {}
        self.object(root[2], "")

    def group(self, place: int) -> tuple[int, ...]:
        if not place:
            return ()
        assert place < DATA
        (count,) = struct.unpack_from("<Q", self.content, place)
        return struct.unpack_from(f"<{count}Q", self.content, place + 8)

    def data(self, entry: int) -> bytes:
        assert entry & DATA
        place = entry - DATA
        if not place:
            return b""
        (size,) = struct.unpack_from("<Q", self.content, place)
        assert place + 8 + size <= len(self.content)
        return self.content[place + 8 : place + 8 + size]

    @staticmethod
    def pairs(text: str) -> dict[str, str]:
        return dict(pair.split("=", 1) for pair in text.split(";")) if text else {}

    def object(self, place: int, path: str) -> None:
        entries = self.group(place)
        self.compound(entries[0], path)
        headers, at, found = self.data(entries[-1])[:-32], 0, []
        while at < len(headers):
            (size,) = struct.unpack_from("<I", headers, at)
            name = headers[at + 4 : at + 4 + size].decode()
            self.schemas[f"{path}/{name}"] = self.pairs(self.indexed[headers[at + 4 + size]])
            found.append(f"{path}/{name}")
            at += 5 + size
        assert len(found) == len(entries) - 2
        for child, entry in zip(found, entries[1:-1], strict=True):
            self.object(entry, child)

    def compound(self, place: int, path: str) -> None:
        entries = self.group(place)
        headers, at, index = self.data(entries[-1]) if entries else b"", 0, 0
        while at < len(headers):
            (info,) = struct.unpack_from("<I", headers, at)
            kind = info & 3
            count = 1 + (2 * (info >> 9 & 1) + (info >> 8 & 1) + 1 if kind else 0)
            *numbers, size = struct.unpack_from(f"<{count}{'BHI'[info >> 2 & 3]}", headers, at + 4)
            at += 4 + count * (1, 2, 4)[info >> 2 & 3]
            name = f"{path}/{headers[at : at + size].decode()}"
            at += size
            metadata = self.pairs(self.indexed[info >> 20 & 255])
            if kind:
                self.properties[name] = self.sampled(info, numbers, self.group(entries[index]), metadata)
            else:
                self.schemas[name] = metadata
                self.compound(entries[index], name)
            index += 1
        assert index == max(len(entries) - 1, 0)

    def sampled(self, info: int, numbers: list[int], entries: tuple[int, ...], metadata: dict[str, str]) -> Property:
        count, *rest = numbers
        first, last = (0, 0) if info >> 11 & 1 else rest[:2] if info >> 9 & 1 else (1, count - 1)
        most, step, start = self.samplings[rest[-1] if info >> 8 & 1 else 0]
        assert count <= most or last == 0
        is_array, extent = bool(info & 2), info >> 12 & 255
        stored = []
        for entry in entries[:: 2 if is_array else 1]:
            values = np.frombuffer(self.data(entry)[16:], NUMBERS[info >> 4 & 15]).reshape(-1, extent)
            assert len(values) == 1 or is_array
            stored.append(values)
        # which of them a time's is: those before the first change are alike, and those after the last
        places = [0 if i < first or not last else min(i, last) - first + 1 for i in range(count)]
        assert max(places) == len(stored) - 1
        sizes = {len(values) for values in stored}
        assert bool(info >> 10 & 1) == (len(sizes) == 1)
        if is_array:
            assert bool(info & 1) == (sizes == {1})
        return Property([stored[i] for i in places], metadata, [start + step * i for i in range(count)], len(stored))
