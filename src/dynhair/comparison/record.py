"""A comparison on disk: what is compared with what, and how far each row has got."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from dynhair.comparison.methods import HAIR
from dynhair.config import Config, read_config, write_config
from dynhair.errors import DynhairError
from dynhair.storage import read_json, write_json

TableName = Literal["baselines", "ablations"]
RowState = Literal["pending", "done", "failed"]

COMPARISON = "comparison.json"
CONFIG = "config.yaml"
_KIND = "dynhair comparison"


@dataclass(frozen=True)
class Row:
    """One row of a table, or what rows share.

    Attributes:
        name: unique; that of its folder.
        label: its name in tables; rows that differ by the seed alone have one label.
        method: how it is made, see :mod:`dynhair.comparison.methods`.
        seed: of everything random.
        folder: of its run, relative to the comparison's.
        seconds_trained: how long its own training took, steps done again after a kill included; None if it was not
            trained here.
        state: how far it is; what has begun and is not done is pending.
        error: why it failed; None if it has not.
        peak_memory: bytes that its process took at most; None if unknown.
    """

    name: str
    label: str
    method: str
    seed: int
    folder: str
    seconds_trained: float | None = 0.0
    state: RowState = "pending"
    error: str | None = None
    peak_memory: int | None = None


@dataclass
class Comparison:
    """The folder of a comparison.

    Attributes:
        path: the folder.
        table: which of the paper's tables the rows belong to.
        capture: the capture that all rows are trained and measured on.
        preset: name of what the configuration began as.
        config: what all rows have in common; rows have their own seeds.
        rows: of the table, and the canonical hair that they share.
        drivers: captures of other people that drive all rows as well, by the names of their folders.
    """

    path: Path
    table: TableName
    capture: Path
    preset: str
    config: Config
    rows: dict[str, Row] = field(default_factory=dict)
    drivers: dict[str, Path] = field(default_factory=dict)

    @classmethod
    def exists(cls, path: Path) -> bool:
        """Whether a comparison has begun in a folder."""
        return (path / COMPARISON).exists()

    @classmethod
    def read(cls, path: Path) -> Comparison:
        """Read a comparison.

        Raises:
            DynhairError: there is none, or it is not readable.
        """
        file = path / COMPARISON
        value = read_json(file)
        if value.get("kind") != _KIND:
            raise DynhairError(f"kind {value.get('kind')!r}", path=file, expected=f"a '{_KIND}'")
        try:
            rows = [Row(**row) for row in [*value["shared"], *value["rows"]]]
            return cls(
                path,
                value["table"],
                Path(value["capture"]),
                value["preset"],
                read_config(path / CONFIG),
                {row.name: row for row in rows},
                {name: Path(driver) for name, driver in value.get("drivers", {}).items()},
            )
        except (AttributeError, KeyError, TypeError) as error:
            raise DynhairError(f"not readable ({error})", path=file, mend="begin another comparison") from None

    def create(self) -> None:
        """Write the configuration, once, and the rest.

        Raises:
            DynhairError: something else is in the folder.
        """
        if self.path.exists() and (
            not self.path.is_dir() or any(not kept.name.startswith(".") for kept in self.path.iterdir())
        ):
            raise DynhairError(
                "there is something that is no comparison", path=self.path, expected="a new or empty folder"
            )
        self.path.mkdir(parents=True, exist_ok=True)
        write_config(self.config, self.path / CONFIG)
        self.write()

    def write(self) -> None:
        """Write how far the rows are, atomically."""
        value: dict[str, Any] = {
            "kind": _KIND,
            "table": self.table,
            "capture": str(self.capture),
            "iterations": self.config.training.iterations,
            "preset": self.preset,
            "rows": [dataclasses.asdict(row) for row in self.rows.values() if row.method != HAIR],
            "shared": [dataclasses.asdict(row) for row in self.rows.values() if row.method == HAIR],
            "drivers": {name: str(driver) for name, driver in self.drivers.items()},
        }
        write_json(self.path / COMPARISON, value)

    def folder(self, name: str) -> Path:
        """The folder of a row."""
        return self.path / self.rows[name].folder

    def change(self, name: str, **changes: Any) -> None:
        """Change what is known of a row, in memory alone."""
        self.rows[name] = dataclasses.replace(self.rows[name], **changes)

    def require_same(self, other: Comparison) -> None:
        """Refuse to go on with this comparison as if it were another one.

        Raises:
            DynhairError: tables, captures or configurations differ; the message names all that does.
        """
        differences = [
            f"{name} {mine} (asked for: {theirs})"
            for name, mine, theirs in (
                ("table", self.table, other.table),
                ("capture", self.capture, other.capture),
                *((f"driver {name}", driver, other.drivers.get(name, driver)) for name, driver in self.drivers.items()),
                *_differences(self.config, other.config),
            )
            if mine != theirs
        ]
        if differences:
            raise DynhairError(
                "the comparison there has " + ", ".join(differences),
                path=self.path,
                mend="repeat the command that began it, or choose another folder",
            )


def require_same_settings(mine: Config, theirs: Config, path: Path) -> None:
    """Refuse a row whose run was begun with another configuration.

    Raises:
        DynhairError: the configurations differ; the message names the settings.
    """
    differences = [f"{name} {a} (expected: {b})" for name, a, b in _differences(mine, theirs)]
    if differences:
        raise DynhairError(
            "the run there has " + ", ".join(differences), path=path, mend="delete the folder to train it again"
        )


def _differences(mine: Config, theirs: Config) -> Sequence[tuple[str, Any, Any]]:
    """Settings that differ. A precision that is not decided yet agrees with any."""
    undecided = "auto" in (mine.training.precision, theirs.training.precision)
    values = dict(_flat(dataclasses.asdict(theirs)))
    return [
        (name, value, values[name])
        for name, value in _flat(dataclasses.asdict(mine))
        if value != values[name] and not (undecided and name == "training.precision")
    ]


def _flat(value: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, item in value.items():
        if isinstance(item, dict):
            yield from _flat(item, f"{prefix}{name}.")
        else:
            yield prefix + name, item
