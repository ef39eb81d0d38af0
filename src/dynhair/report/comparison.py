"""Comparison folders as they are read: rows of trained and evaluated methods."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any, Literal, cast, get_args

import numpy as np
from jaxtyping import Float

from dynhair.errors import DynhairError
from dynhair.storage import read_json

OURS = "ours"
"""The method that the others are held against."""

TableName = Literal["baselines", "ablations"]
State = Literal["done", "failed", "pending"]

NOT_MEASURED = "this evaluation did not measure it"


@dataclass(frozen=True)
class Row:
    """One training and its evaluation.

    Attributes:
        name: of the row, unique in its comparison.
        label: what readers see; the seeds of one method share it.
        method: ``ours``, a baseline's or an ablation's name.
        seed: of the training.
        folder: of the run.
        seconds: that the training took; None where unknown.
        state: ``failed`` also where the evaluation cannot be read.
        error: why it failed.
        metrics: what the evaluation wrote; empty where there is none.
        place: of the evaluation, relative to the run's folder.
    """

    name: str
    label: str
    method: str
    seed: int
    folder: Path
    seconds: float | None
    state: State
    error: str = ""
    metrics: Mapping[str, Any] = field(default_factory=dict)
    place: str = "evaluation"

    @property
    def evaluation(self) -> Path:
        """Folder of figures, series, pictures and videos."""
        return self.folder / self.place

    @property
    def test_segments(self) -> list[str]:
        """Names of the motions held out from training, in the capture's order."""
        return [name for name, part in mapping(self.metrics.get("segments")).items() if part.get("split") == "test"]

    def figure(self, name: str, segment: str | None = None) -> float | None:
        """A figure over all test segments, or over one segment; None where it was not measured."""
        return finite(self._part(segment).get(name))

    def figure_of_cost(self, name: str) -> float | None:
        """What the evaluation says of its own cost."""
        return finite(mapping(self.metrics.get("cost")).get(name))

    def reason(self, name: str) -> str:
        """Say why a figure is missing."""
        if self.state != "done":
            return self.problem
        return str(mapping(self.metrics.get("reasons")).get(name, NOT_MEASURED))

    @property
    def problem(self) -> str:
        """Why the row has no figures; empty where it has."""
        if self.state == "done":
            return ""
        return "not run yet" if self.state == "pending" else f"failed: {self.error or 'no reason was recorded'}"

    def series(self) -> dict[str, Float[np.ndarray, " t"]]:
        """Read the figures over time, by ``<segment>/<name>``; empty where there are none.

        Raises:
            DynhairError: the file is damaged.
        """
        path = self.evaluation / "series.npz"
        if not path.exists():
            return {}
        try:
            with np.load(path, allow_pickle=False) as stored:
                return {name: np.asarray(stored[name], np.float64) for name in stored.files}
        except (OSError, ValueError, zipfile.BadZipFile) as error:
            raise DynhairError(f"not readable as series ({error})", path=path, mend="evaluate this row again") from None

    def _part(self, segment: str | None) -> Mapping[str, Any]:
        return self.metrics if segment is None else mapping(mapping(self.metrics.get("segments")).get(segment))


@dataclass(frozen=True)
class Comparison:
    """Methods trained alike on one capture.

    Attributes:
        path: the folder.
        table: what is compared.
        capture: name of the capture.
        iterations: of each training.
        preset: of the configuration.
        rows: in the order of tables.
        drivers: names of other people's captures that drove the rows as well.
    """

    path: Path
    table: TableName
    capture: str
    iterations: int
    preset: str
    rows: tuple[Row, ...]
    drivers: tuple[str, ...] = ()

    @classmethod
    def open(cls, path: Path | str) -> Comparison:
        """Read ``comparison.json`` and the figures of every row that is done.

        A row whose figures cannot be read counts as failed.

        Raises:
            DynhairError: the folder holds no comparison, or a damaged one.
        """
        path = Path(path)
        file = path / "comparison.json"
        raw = read_json(file)
        if raw.get("kind") != "dynhair comparison":
            raise DynhairError(
                f"its kind is {raw.get('kind')!r}",
                path=file,
                expected="'dynhair comparison', as `dynhair compare` and `dynhair ablate` write it",
            )
        table = raw.get("table")
        if table not in get_args(TableName):
            raise DynhairError(f"its table is {table!r}", path=file, expected=" or ".join(get_args(TableName)))
        rows = raw.get("rows")
        if not isinstance(rows, list) or not rows:
            raise DynhairError("it has no rows", path=file, expected="a list of rows")
        return cls(
            path,
            cast(TableName, table),
            Path(_text(raw, "capture", file)).name,
            int(_number(raw, "iterations", file)),
            _text(raw, "preset", file),
            tuple(_row(row, path, file) for row in rows),
            _drivers(raw, file),
        )

    def driven_by(self, driver: str) -> Comparison | None:
        """The same as another person drove it; None where no row was driven."""
        rows = tuple(_driven(row, f"driven_by/{driver}") for row in self.rows)
        return replace(self, rows=rows, drivers=()) if any(row.metrics for row in rows) else None

    def held_out(self) -> Comparison | None:
        """The same over the views that training held out alone; None where no row has such views."""
        rows = []
        for row in self.rows:
            apart = mapping(row.metrics.get("held_out_views"))
            rows.append(replace(row, metrics=apart if apart.get("views") else {}))
        return replace(self, rows=tuple(rows)) if any(row.metrics for row in rows) else None


def finite(value: object) -> float | None:
    """A finite number as a float, anything else as None."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def mapping(value: object) -> Mapping[str, Any]:
    """A JSON object as it is, anything else as an empty one."""
    return value if isinstance(value, Mapping) else {}


def _row(raw: object, folder: Path, file: Path) -> Row:
    if not isinstance(raw, dict):
        raise DynhairError(f"a row is a JSON {type(raw).__name__}", path=file, expected="a JSON object")
    name = _text(raw, "name", file)
    state = raw.get("state")
    if state not in get_args(State):
        raise DynhairError(f"the state of row '{name}' is {state!r}", path=file, expected=" or ".join(get_args(State)))
    place = PurePosixPath(_text(raw, "folder", file))
    if place.is_absolute() or ".." in place.parts:
        raise DynhairError(f"row '{name}' lies at '{place}'", path=file, expected="a folder inside the comparison's")
    error, metrics = str(raw.get("error") or ""), {}
    if state == "done":
        metrics, damage = _figures(folder, f"{place}/evaluation")
        state, error = ("failed", damage) if damage else (state, error)
    return Row(
        name=name,
        label=_text(raw, "label", file),
        method=_text(raw, "method", file),
        seed=int(_number(raw, "seed", file)),
        folder=folder / place,
        seconds=finite(raw.get("seconds_trained")),
        state=cast(State, state),
        error=error,
        metrics=metrics,
    )


def _driven(row: Row, place: str) -> Row:
    """A row with the figures of a place in its folder, where it is done."""
    apart = replace(row, place=place, metrics={})
    if row.state != "done":
        return apart
    if not (apart.evaluation / "metrics.json").exists():
        return replace(apart, state="pending")
    metrics, damage = _figures(row.folder, place)
    return replace(apart, state="failed", error=damage) if damage else replace(apart, metrics=metrics)


def _figures(folder: Path, place: str) -> tuple[Mapping[str, Any], str]:
    """What an evaluation inside a folder wrote, and why it cannot be read; one of them is empty."""
    try:
        return read_json(folder / place / "metrics.json"), ""
    except DynhairError as damage:
        return {}, f"its evaluation cannot be read: {place}/metrics.json: {damage.message}"


def _drivers(raw: Mapping[str, Any], file: Path) -> tuple[str, ...]:
    names = tuple(mapping(raw.get("drivers")))
    for name in names:
        if PurePosixPath(name).name != name:
            raise DynhairError(f"a driver is named '{name}'", path=file, expected="the name of a folder")
    return names


def _text(raw: Mapping[str, Any], key: str, file: Path) -> str:
    value = raw.get(key)
    if not isinstance(value, str) or not value:
        raise DynhairError(f"'{key}' is {value!r}", path=file, expected="a text")
    return value


def _number(raw: Mapping[str, Any], key: str, file: Path) -> float:
    value = finite(raw.get(key))
    if value is None:
        raise DynhairError(f"'{key}' is {raw.get(key)!r}", path=file, expected="a number")
    return value
