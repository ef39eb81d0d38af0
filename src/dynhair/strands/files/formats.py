"""Which reader and writer a file's name asks for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from jaxtyping import Float
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.strands.files.alembic import read_abc
from dynhair.strands.files.archive import read_npz, write_npz
from dynhair.strands.files.cem_yuksel import read_hair, write_hair
from dynhair.strands.files.polygon import read_ply, write_ply
from dynhair.strands.files.salon import read_data, write_data
from dynhair.strands.files.strand_file import StrandFile
from dynhair.strands.files.usd import read_usd

_Function = TypeVar("_Function")

_READERS = {
    ".hair": read_hair,
    ".data": read_data,
    ".ply": read_ply,
    ".npz": read_npz,
    ".abc": read_abc,
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), read_usd),
}
_WRITERS = {".hair": write_hair, ".data": write_data, ".ply": write_ply, ".npz": write_npz}


def read_strands(path: Path | str) -> StrandFile:
    """Read strands from a file of the format that its name ends in.

    Args:
        path: ``.hair`` (Cem Yuksel), ``.data`` (USC-HairSalon), ``.ply``, ``.npz``, ``.abc`` (Alembic) or a USD stage,
            ``.usd``, ``.usda``, ``.usdc`` or ``.usdz``.

    Returns:
        The strands in the file's own unit and axes (those of USD stages in metres, y up); bring them onto a head with
        :func:`dynhair.strands.fitting.fit_to_scalp`.

    Raises:
        DynhairError: the format is unknown, or the file cannot be read or holds anything but finite strands.
    """
    path = Path(path)
    return _chosen(_READERS, path, "read")(path)


def write_strands(path: Path | str, strands: StrandFile | Float[Tensor, "n l 3"]) -> None:
    """Write strands to a file of the format that its name ends in, atomically.

    Points are kept to the last bit of their float32. What a format has no place for is left out: ``.data`` holds points
    alone.

    Args:
        path: ``.hair``, ``.data``, ``.ply`` or ``.npz``.
        strands: of different numbers of points, or of equally many.

    Raises:
        DynhairError: the format is unknown or cannot count so far, or there are no strands or numbers that are not
            finite.
    """
    path = Path(path)
    write = _chosen(_WRITERS, path, "written")
    strands = strands if isinstance(strands, StrandFile) else StrandFile.of(strands)
    strands.check(path)
    write(path, strands)


def _chosen(formats: Mapping[str, _Function], path: Path, done: str) -> _Function:
    try:
        return formats[path.suffix.lower()]
    except KeyError:
        raise DynhairError(
            f"strands cannot be {done} as {path.suffix or 'a file without an ending'}",
            path=path,
            expected=", ".join(formats),
        ) from None
