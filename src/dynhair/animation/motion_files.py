"""Head motion in files: ``.npz``, ``.json`` and ``.csv``, all of the same columns. docs/animate.md describes them."""

from __future__ import annotations

import csv
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dynhair.animation.motion_columns import COLUMNS, Column, Columns, motion_columns, motion_of_columns
from dynhair.animation.timed_motion import TimedMotion
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.storage import atomic_file, read_json

CSV_AXES = {"rotation": ("qw", "qx", "qy", "qz"), "translation": ("tx", "ty", "tz"), "time": ("time",)}
CSV_ROTATION_VECTOR = ("rx", "ry", "rz")
CSV_MATRIX = tuple(f"r{row}{column}" for row in range(3) for column in range(3))


def read_motion(path: Path | str) -> TimedMotion:
    """Read a motion file. Nothing in it is executed.

    Raises:
        DynhairError: the file is missing, of another kind, damaged, incomplete, or holds no sound motion.
    """
    path = Path(path)
    if not path.is_file():
        raise DynhairError("there is no such file", path=path, expected="a motion: .npz, .json or .csv")
    return motion_of_columns(_format(path).read(path), path)


def write_motion(path: Path | str, motion: TimedMotion | HeadTrack) -> None:
    """Write a motion atomically, in the format that the path's ending names; rotations as unit quaternions, wxyz.

    Raises:
        DynhairError: the ending is none of those, or the file cannot be written; or the name of an expression cannot
            stand at the head of a column.
    """
    path = Path(path)
    write = _format(path).write
    columns = motion_columns(TimedMotion.of(motion) if isinstance(motion, HeadTrack) else motion)
    if write is _write_csv:
        _require_headings(columns, path)
    with atomic_file(path) as temporary:
        write(temporary, columns)


def _format(path: Path) -> _Format:
    found = _FORMATS.get(path.suffix.lower())
    if found is None:
        raise DynhairError(
            f"`{path.suffix}` is no ending of a motion file", path=path, expected=" or ".join(MOTION_SUFFIXES)
        )
    return found


def _read_npz(path: Path) -> Columns:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise DynhairError(f"not readable as .npz ({error})", path=path, expected="arrays without objects") from None


def _write_npz(path: Path, columns: Columns) -> None:
    with path.open("wb") as file:
        np.savez(file, **columns)  # pyright: ignore[reportArgumentType]


def _read_json(path: Path) -> Columns:
    columns = {}
    for name, value in read_json(path).items():
        try:
            columns[name] = np.array(value)
        except ValueError:
            raise DynhairError(f"the rows of `{name}` are of several lengths", path=path) from None
    return columns


def _write_json(path: Path, columns: Columns) -> None:
    values = {name: json.dumps(column.tolist(), allow_nan=False) for name, column in columns.items()}
    lines = ",\n".join(f" {json.dumps(name)}: {value}" for name, value in values.items())
    path.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")


def _read_csv(path: Path) -> Columns:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DynhairError(f"not readable as text ({error})", path=path) from None
    columns = {}
    for line in (line[1:] for line in lines if line.startswith("#")):
        name, separator, values = line.partition(":")
        column = COLUMNS.get(name.strip())
        if separator and column is not None and not column.per_frame:
            columns[name.strip()] = _constant(column, name.strip(), values, path)
    rows = list(csv.reader(line for line in lines if line.strip() and not line.startswith("#")))
    if len(rows) < 2:
        raise DynhairError("holds no frames", path=path, expected="a header, and a line for each frame")
    header = [name.strip() for name in rows[0]]
    if len(set(header)) < len(header):
        raise DynhairError("two columns have one name", path=path, expected="names that differ")
    return {**columns, **_csv_columns(header, _table(rows, header, path))}


def _require_headings(columns: Columns, path: Path) -> None:
    """Make sure that names of expressions are read again from a header as they are."""
    taken = {*CSV_ROTATION_VECTOR, *CSV_MATRIX, *(name for names in CSV_AXES.values() for name in names)}
    for name in columns.get("expression_names", np.empty(0)).tolist():
        if name in taken or name != name.strip() or len(name.splitlines()) > 1:
            raise DynhairError(
                f"an expression is called {name!r}",
                path=path,
                expected=f"other names than {', '.join(sorted(taken))}, on one line, without blanks around them",
                mend="write .npz or .json, which take any",
            )


def _table(rows: list[list[str]], header: list[str], path: Path) -> np.ndarray:
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(header):
            raise DynhairError(
                f"frame {number} has {len(row)} values", path=path, expected=f"{len(header)}, as the header names"
            )
    try:
        return np.array(rows[1:], np.float64)
    except ValueError as error:
        raise DynhairError(
            f"a value is no number ({error})", path=path, expected="numbers with a decimal point"
        ) from None


def _csv_columns(header: list[str], table: np.ndarray) -> Columns:
    places = {name: place for place, name in enumerate(header)}
    columns, used = {}, set[str]()
    axes = [("time", CSV_AXES["time"]), ("translation", CSV_AXES["translation"])]
    axes += [("rotation", names) for names in (CSV_MATRIX, CSV_ROTATION_VECTOR, CSV_AXES["rotation"])]
    for name, parts in axes:
        if all(part in places for part in parts):
            values = table[:, [places[part] for part in parts]]
            columns[name] = values[:, 0] if name == "time" else values
            used.update(parts)
    if columns.get("rotation", table[:, :0]).shape[1] == 9:
        columns["rotation"] = columns["rotation"].reshape(-1, 3, 3)
    expressions = [name for name in header if name not in used]
    if expressions:
        columns["expression"] = table[:, [places[name] for name in expressions]]
        names = ["" if name == _unnamed(place) else name for place, name in enumerate(expressions)]
        if any(names):
            columns["expression_names"] = np.array(names)
    return columns


def _unnamed(place: int) -> str:
    """What the column of a coefficient without a name is called."""
    return f"expression_{place}"


def _constant(column: Column, name: str, values: str, path: Path) -> np.ndarray:
    if column.text:
        return np.array(values.strip())
    try:
        numbers = np.array(values.split(), np.float64)
    except ValueError:
        raise DynhairError(f"`# {name}` is no row of numbers", path=path, expected=f"# {name}: 0 1 2") from None
    return numbers[0] if name == "fps" and len(numbers) == 1 else numbers


def _write_csv(path: Path, columns: Columns) -> None:
    text = io.StringIO(newline="")
    for name, value in columns.items():
        if not COLUMNS[name].per_frame and name != "expression_names":
            shown = str(value) if COLUMNS[name].text else " ".join(map(repr, value.ravel().tolist()))
            text.write(f"# {name}: {shown}\n")
    told = columns["expression_names"].tolist() if "expression_names" in columns else []
    names = [name or _unnamed(place) for place, name in enumerate(told or [""] * columns["expression"].shape[1])]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*CSV_AXES["time"], *CSV_AXES["rotation"], *CSV_AXES["translation"], *names])
    frames = np.column_stack([columns[name] for name in ("time", "rotation", "translation", "expression")])
    writer.writerows([map(repr, frame) for frame in frames.tolist()])
    path.write_text(text.getvalue(), encoding="utf-8")


class _Format(NamedTuple):
    read: Callable[[Path], Columns]
    write: Callable[[Path, Columns], None]


_FORMATS: Mapping[str, _Format] = {
    ".npz": _Format(_read_npz, _write_npz),
    ".json": _Format(_read_json, _write_json),
    ".csv": _Format(_read_csv, _write_csv),
}
MOTION_SUFFIXES = tuple(_FORMATS)
