"""What the page shows, in the form that its template takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dynhair import __version__
from dynhair.report.columns import Column, figures_of
from dynhair.report.comparison import OURS, Comparison, Row, TableName, mapping
from dynhair.report.media import shown_rows
from dynhair.report.scores import Contender, Scene, Score
from dynhair.report.tables import Table
from dynhair.report.verdicts import Finding, judge

_HEADINGS: Mapping[TableName, str] = {"baselines": "Baselines", "ablations": "Ablations"}
_OTHERS: Mapping[TableName, str] = {"baselines": "a baseline", "ablations": "another variant"}


@dataclass
class Film:
    """A motion as pictures and video.

    Attributes:
        name: of the motion.
        labels: of the columns.
        sheet: URL of the contact sheet.
        video: URL, relative or with the video in it.
    """

    name: str
    labels: Sequence[str]
    sheet: str
    video: str


@dataclass
class DrivenPart:
    """What a page shows of one capture's methods as another person drives them.

    Attributes:
        driver: name of that person's capture.
        tables: filled.
        films: of the motions.
    """

    driver: str
    tables: list[Table]
    films: list[Film]


@dataclass
class ScenePart:
    """All that a page shows of one capture.

    Attributes:
        scene: its figures.
        tables: filled.
        comparison: that it is from; None of a mean over captures.
        plots: by segment, SVG.
        films: of the test motions.
        held_out: tables over the views held out from training.
        driven: by other people.
    """

    scene: Scene
    tables: list[Table]
    comparison: Comparison | None = None
    plots: dict[str, str] = field(default_factory=dict)
    films: list[Film] = field(default_factory=list)
    held_out: list[Table] = field(default_factory=list)
    driven: list[DrivenPart] = field(default_factory=list)

    @property
    def all_films(self) -> list[Film]:
        """Those of the test motions, and those of other people's."""
        return self.films + [film for part in self.driven for film in part.films]


@dataclass
class TablePart:
    """All comparisons of one kind.

    Attributes:
        kind: what is compared.
        average: over captures; None of a single one.
        scenes: one a capture.
    """

    kind: TableName
    average: ScenePart | None
    scenes: list[ScenePart]

    @property
    def first(self) -> ScenePart:
        """What the page shows first."""
        return self.average or self.scenes[0]


def page_values(parts: Sequence[TablePart], problems: Sequence[str], study: str | None) -> dict[str, Any]:
    """Lay out the page.

    Args:
        parts: in the order of the page.
        problems: what could not be read.
        study: file name of the page of the study; None where there is none.
    """
    captures = dict.fromkeys(part.scene.name for each in parts for part in each.scenes)
    return {
        "title": f"{' and '.join(_HEADINGS[part.kind].lower() for part in parts)}: {', '.join(captures)}".capitalize(),
        "version": __version__,
        "parts": [_part(part) for part in parts],
        "problems": problems,
        "study": study,
    }


def _part(part: TablePart) -> dict[str, Any]:
    return {
        "kind": part.kind,
        "heading": _HEADINGS[part.kind],
        "others": _OTHERS[part.kind],
        "facts": [_facts(scene.comparison) for scene in part.scenes if scene.comparison],
        "first": _scene(part.first),
        "scenes": [_scene(scene) for scene in part.scenes],
        "averaged": part.average is not None,
    }


def _scene(part: ScenePart) -> dict[str, Any]:
    verdicts = judge(part.scene)
    return {
        "name": part.scene.name,
        "behind": [_finding(finding) for finding in verdicts.behind],
        "ahead": [_finding(finding) for finding in verdicts.ahead],
        "level": verdicts.level,
        "missing": verdicts.missing,
        "failed": [(c.label, c.problem) for c in part.scene.contenders if c.problem],
        "notes": [(c.label, note) for c in part.scene.contenders for note in c.notes],
        "tables": [_table(table) for table in part.tables],
        "held_out": [_table(table) for table in part.held_out],
        "cost": [_cost(contender) for contender in part.scene.contenders],
        "plots": part.plots,
        "films": part.films,
        "driven": [
            {"driver": d.driver, "tables": [_table(t) for t in d.tables], "films": d.films} for d in part.driven
        ],
        "measured": None if part.comparison is None else _measured(part.comparison),
    }


def _facts(comparison: Comparison) -> str:
    rows = len(comparison.rows)
    return f"{comparison.capture}: {rows} trainings of {comparison.iterations:,} steps, preset {comparison.preset}"


def _finding(finding: Finding) -> dict[str, Any]:
    return {"figure": finding.figure, "sentence": finding.sentence, "sure": finding.beyond_spread}


def _table(table: Table) -> dict[str, Any]:
    notes: dict[str, int] = {}

    def note(reason: str) -> int | None:
        return notes.setdefault(reason, len(notes) + 1) if reason else None

    lines = [
        {
            "label": line.label,
            "ours": line.ours,
            "note": note("; ".join(line.notes)),
            "problem": line.problem,
            "cells": [{"cell": cell, "note": note(cell.reason)} for cell in line.cells],
        }
        for line in table.lines
    ]
    return {
        "title": table.layout.title,
        "groups": [(group.heading, len(group.columns)) for group in table.layout.groups],
        "columns": [
            {"heading": _heading(column), "goal": goal.value, "name": column.name, "first": first}
            for column, goal, first in zip(table.layout.columns, table.goals, _firsts(table), strict=True)
        ],
        "lines": lines,
        "truth": table.truth,
        "notes": notes,
        "seeds": max(line.seeds for line in table.lines),
    }


def _firsts(table: Table) -> list[bool]:
    """Whether each column begins a group."""
    return [index == 0 for group in table.layout.groups for index, _ in enumerate(group.columns)]


def _heading(column: Column) -> tuple[str, str]:
    """Heading and subscript."""
    base, _, subscript = column.heading.partition("_")
    return base, subscript


def _cost(contender: Contender) -> tuple[str, str, str]:
    training, evaluation = contender.training_seconds, contender.evaluation_seconds
    return contender.label, _duration(training), "n/a" if evaluation.mean is None else f"{evaluation.mean:.1f} s"


def _duration(seconds: Score) -> str:
    if seconds.mean is None:
        return "n/a"
    whole = round(seconds.mean)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def _measured(comparison: Comparison) -> dict[str, Any]:
    """Protocol, definitions and sample counts, and in what the methods' protocols differ."""
    rows = shown_rows(comparison)
    protocols = {row.label: {k: str(v) for k, v in mapping(row.metrics.get("protocol")).items()} for row in rows}
    entries = []
    for name in dict.fromkeys(key for protocol in protocols.values() for key in protocol):
        said: dict[str, list[str]] = {}
        for label, protocol in protocols.items():
            said.setdefault(protocol.get(name, "not said"), []).append(label)
        texts = [(text, labels if len(said) > 1 else []) for text, labels in said.items()]
        entries.append((name.replace("_", " "), texts))
    columns = figures_of(comparison.table)
    definitions = {k: v for row in reversed(rows) for k, v in mapping(row.metrics.get("definitions")).items()}
    return {
        "protocol": entries,
        "labels": [row.label for row in rows],
        "figures": [
            {
                "name": column.name,
                "key": column.key,
                "definition": str(definitions.get(column.key, "not defined by these evaluations")),
                "samples": [_samples(row, column.key) for row in rows],
            }
            for column in columns
        ],
        "ours": next((row.label for row in rows if row.method == OURS), None),
    }


def _samples(row: Row, key: str) -> str:
    count = mapping(row.metrics.get("samples")).get(key)
    return f"{count:,}" if isinstance(count, int) else "n/a"
