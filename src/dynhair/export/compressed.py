"""Compressed splats: the ``.compressed.ply`` files of PlayCanvas, a quarter of the size of plain ones.

Written with NumPy. The library that writes them too, gsply, takes Numba and LLVM along, ten times its own size, for
what are five bit fields; it serves the tests as an independent reader.

256 Gaussians that lie together share the bounds of their positions, log-scales and colours, within which each has 11,
10 and 11 bits for a position and for log-scales, and 8 for a channel of the colour and for the opacity. A rotation has
2 bits for which component is largest and 10 for each of the others, a harmonic of the higher degrees 8 bits for
[-4, 4].
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt32
from scipy.special import expit

from dynhair.errors import DynhairError
from dynhair.export.splats import COLUMNS, Splats, splat_table
from dynhair.storage import atomic_file

CHUNK = 256  # Gaussians that share their bounds

_C0 = 0.28209479177387814
_LOG_SCALES = 20.0  # viewers take none beyond
_HARMONICS = 8.0  # width of what 8 bits hold
_BITS = 21  # of each coordinate in the order along a curve


def write_compressed_splats(path: Path | str, splats: Splats) -> None:
    """Write a ``.compressed.ply`` file, atomically, in the axes of :func:`~dynhair.export.splats.write_splats`.

    The Gaussians are put in another order, in which neighbours lie together.

    Raises:
        DynhairError: there are none.
    """
    path = Path(path)
    if not len(splats.means):
        raise DynhairError("there is no Gaussian to write", path=path)
    table = splat_table(splats).numpy()
    table = table[_along_a_curve(table[:, :3])]
    columns = {name: place for place, name in enumerate(COLUMNS)}
    part = {name: table[:, columns[first] : columns[first] + width] for name, first, width in _PARTS}

    positions, bounds = _within_chunks(part["means"])
    log_scales, scale_bounds = _within_chunks(part["log_scales"].clip(-_LOG_SCALES, _LOG_SCALES))
    colours, colour_bounds = _within_chunks(0.5 + _C0 * part["base"])
    opacities = expit(part["logits"])
    vertices = np.stack(
        [
            _packed(positions, (11, 10, 11)),
            _packed_rotations(part["quats"]),
            _packed(log_scales, (11, 10, 11)),
            _packed(np.concatenate([colours, opacities], 1), (8, 8, 8, 8)),
        ],
        axis=1,
    )
    # Nought lies halfway between two steps: rounded up or down at random, its errors cancel where Gaussians blend.
    steps = (part["higher"] / _HARMONICS + 0.5) * 256 - 0.5
    dither = np.random.default_rng(0).random(steps.shape, np.float32)
    harmonics = np.floor(steps + dither).clip(0, 255).astype(np.uint8)
    chunks = np.concatenate([bounds, scale_bounds, colour_bounds], 1).astype("<f4")
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        file.write(_header(len(chunks), len(table)))
        for block in (chunks, vertices.astype("<u4"), harmonics):
            file.write(block.tobytes())


_PARTS = (
    ("means", "x", 3),
    ("base", "f_dc_0", 3),
    ("higher", "f_rest_0", 45),
    ("logits", "opacity", 1),
    ("log_scales", "scale_0", 3),
    ("quats", "rot_0", 4),
)


def _header(chunks: int, count: int) -> bytes:
    bounded = (("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b"))
    bounds = [f"{end}_{name}" for names in bounded for end in ("min", "max") for name in names]
    packed = [f"packed_{name}" for name in ("position", "rotation", "scale", "color")]
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres; x right, y down, z forward",
        f"element chunk {chunks}",
        *(f"property float {name}" for name in bounds),
        f"element vertex {count}",
        *(f"property uint {name}" for name in packed),
        f"element sh {count}",
        *(f"property uchar f_rest_{i}" for i in range(45)),
        "end_header",
    ]
    return ("\n".join(lines) + "\n").encode("ascii")


def _along_a_curve(points: Float32[np.ndarray, "n 3"]) -> np.ndarray:
    """An order in which neighbours lie together: that of the bits of their coordinates, in turn (Morton)."""
    low = points.min(0)
    extent = np.maximum((points - low).max(), 1e-9)
    cells = ((points - low).astype(np.float64) / extent * (2**_BITS - 1)).astype(np.uint64)
    codes = np.zeros(len(points), np.uint64)
    for bit in range(_BITS):
        for axis in range(3):
            codes |= (cells[:, axis] >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(codes, kind="stable")


def _within_chunks(
    values: Float32[np.ndarray, "n c"],
) -> tuple[Float32[np.ndarray, "n c"], Float32[np.ndarray, "k d"]]:
    """Values as shares of the way from the least to the greatest of their chunk, and these two."""
    starts = np.arange(0, len(values), CHUNK)
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    chunk = np.arange(len(values)) // CHUNK
    width = np.maximum(high - low, np.finfo(np.float32).tiny)
    return ((values - low[chunk]) / width[chunk]).clip(0, 1), np.concatenate([low, high], 1)


def _packed(shares: Float32[np.ndarray, "n c"], bits: tuple[int, ...]) -> UInt32[np.ndarray, " n"]:
    """Numbers in [0, 1] side by side in 32 bits, the first in the highest."""
    packed = np.zeros(len(shares), np.uint32)
    for share, width in zip(shares.T, bits, strict=True):
        most = (1 << width) - 1
        packed = packed << np.uint32(width) | np.rint(share * most).astype(np.uint32)
    return packed


def _packed_rotations(quats: Float32[np.ndarray, "n 4"]) -> UInt32[np.ndarray, " n"]:
    """Which component is largest, which is made positive, and the three others over sqrt 2, wxyz."""
    largest = np.abs(quats).argmax(1)
    rows = np.arange(len(quats))
    positive = quats * np.where(quats[rows, largest] < 0, -1, 1)[:, None].astype(np.float32)
    others = positive[np.arange(4) != largest[:, None]].reshape(-1, 3)
    shares = (others / np.float32(np.sqrt(2)) + np.float32(0.5)).clip(0, 1)
    return largest.astype(np.uint32) << np.uint32(30) | _packed(shares, (10, 10, 10))
