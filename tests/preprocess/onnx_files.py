"""Tiny ONNX files, written field by field as protocol buffers."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

FLOAT = 1  # of TensorProto.DataType


def write_convolution(
    path: Path, weights: Sequence[float], bias: float, size: tuple[int, int] | None = None, channels: int = 3
) -> Path:
    """Write a network that sums its input's channels by weight: (1, channels, height, width) to (1, 1, height, width).

    Args:
        path: of the file.
        weights: one for each channel.
        bias: added to the sum.
        size: height and width, if they are fixed.
        channels: of the input.
    """
    height, width = size or ("height", "width")
    node = _text(1, "input") + _text(1, "weights") + _text(1, "bias") + _text(2, "output") + _text(4, "Conv")
    graph = (
        _message(1, node)
        + _text(2, "graph")
        + _message(5, _tensor("weights", (1, channels, 1, 1), weights))
        + _message(5, _tensor("bias", (1,), [bias]))
        + _message(11, _value("input", (1, channels, height, width)))
        + _message(12, _value("output", (1, 1, height, width)))
    )
    opset = _number(2, 13)
    path.write_bytes(_number(1, 7) + _message(7, graph) + _message(8, opset))
    return path


def _tensor(name: str, shape: Sequence[int], values: Sequence[float]) -> bytes:
    sizes = b"".join(_number(1, size) for size in shape)
    return sizes + _number(2, FLOAT) + _text(8, name) + _message(9, struct.pack(f"<{len(values)}f", *values))


def _value(name: str, shape: Sequence[int | str]) -> bytes:
    sizes = b"".join(_message(1, _text(2, size) if isinstance(size, str) else _number(1, size)) for size in shape)
    tensor = _number(1, FLOAT) + _message(2, sizes)
    return _text(1, name) + _message(2, _message(1, tensor))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _text(field: int, value: str) -> bytes:
    return _message(field, value.encode())


def _message(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    low = bytes([value & 0x7F])
    return low if value < 0x80 else bytes([low[0] | 0x80]) + _varint(value >> 7)
