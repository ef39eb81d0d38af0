"""Means over seeds and over captures."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dynhair.report.columns import figures_of
from dynhair.report.comparison import NOT_MEASURED, OURS, Comparison, Row, TableName


@dataclass(frozen=True)
class Score:
    """One method's figure.

    Attributes:
        mean: over the seeds; None where no seed measured it.
        spread: sample standard deviation over the seeds; None of fewer than two.
        seeds: that measured it.
        reason: why there is no mean.
    """

    mean: float | None
    spread: float | None = None
    seeds: int = 0
    reason: str = ""

    @classmethod
    def over_seeds(cls, values: Sequence[float | None], reason: str) -> Score:
        """Take the mean of what was measured."""
        known = [value for value in values if value is not None]
        if not known:
            return cls(None, reason=reason)
        return cls(statistics.fmean(known), statistics.stdev(known) if len(known) > 1 else None, len(known))

    @classmethod
    def over_captures(cls, scores: Mapping[str, Score]) -> Score:
        """Take the mean over captures, by name; only where all of them have the figure, or rows would not compare.

        The spread is that of a mean of independent figures.
        """
        means, missing = [], []
        for name, score in scores.items():
            if score.mean is None:
                missing.append(f"{name}: {score.reason}")
            else:
                means.append(score.mean)
        if missing:
            return cls(None, reason="; ".join(missing))
        spreads = [score.spread for score in scores.values() if score.spread is not None]
        whole = len(spreads) == len(means)
        spread = math.sqrt(sum(value**2 for value in spreads)) / len(means) if whole else None
        return cls(statistics.fmean(means), spread, min(score.seeds for score in scores.values()))


@dataclass(frozen=True)
class Contender:
    """A line of the tables: all seeds of one method.

    Attributes:
        label: what readers see.
        method: see `Row`.
        scores: by the figure's key.
        training_seconds: mean over seeds.
        evaluation_seconds: per 100 frames and view, mean over seeds.
        problem: why it has no figures; empty where it has.
        notes: what went wrong with some of its seeds.
    """

    label: str
    method: str
    scores: Mapping[str, Score]
    training_seconds: Score
    evaluation_seconds: Score
    problem: str = ""
    notes: tuple[str, ...] = ()

    @property
    def ours(self) -> bool:
        """Whether the others are held against it."""
        return self.method == OURS


@dataclass(frozen=True)
class Scene:
    """What tables are made of: one capture, or the mean over several.

    Attributes:
        name: of the capture.
        table: what is compared.
        contenders: in the order of the tables.
        truths: the truth's own figures, by key.
    """

    name: str
    table: TableName
    contenders: tuple[Contender, ...]
    truths: Mapping[str, float]

    @classmethod
    def of(cls, comparison: Comparison, name: str) -> Scene:
        """Sum up the seeds of one comparison."""
        rows: dict[str, list[Row]] = {}
        for row in comparison.rows:
            rows.setdefault(row.label, []).append(row)
        contenders = tuple(_contender(comparison.table, some) for some in rows.values())
        truths: dict[str, float] = {}
        for column in figures_of(comparison.table):
            known = [row.figure(column.truth) for row in sorted(comparison.rows, key=lambda row: row.method != OURS)]
            truth = next((value for value in known if value is not None), None)
            if truth is not None:
                truths[column.key] = truth
        return cls(name, comparison.table, contenders, truths)

    @classmethod
    def average(cls, scenes: Sequence[Scene]) -> Scene:
        """Average over captures, method by method."""
        first = scenes[0]
        labels = list(dict.fromkeys(contender.label for scene in scenes for contender in scene.contenders))
        keys = [column.key for column in figures_of(first.table)]
        truths = {
            key: statistics.fmean(scene.truths[key] for scene in scenes)
            for key in keys
            if all(key in scene.truths for scene in scenes)
        }
        contenders = tuple(_average(label, keys, scenes) for label in labels)
        return cls(f"mean of {len(scenes)} captures", first.table, contenders, truths)


def _contender(table: TableName, rows: Sequence[Row]) -> Contender:
    done = [row for row in rows if row.state == "done"]
    judged = done or rows
    scores = {}
    for column in figures_of(table):
        reason = "; ".join(dict.fromkeys(row.reason(column.key) for row in judged))
        scores[column.key] = Score.over_seeds([row.figure(column.key) for row in done], reason)
    costs = [row.figure_of_cost("seconds_per_100_frames_and_view") for row in done]
    return Contender(
        label=rows[0].label,
        method=rows[0].method,
        scores=scores,
        training_seconds=Score.over_seeds([row.seconds for row in done], "not recorded"),
        evaluation_seconds=Score.over_seeds(costs, "not recorded"),
        problem="" if done else "; ".join(dict.fromkeys(row.problem for row in rows)),
        notes=tuple(f"seed {row.seed} {row.problem}" for row in rows if done and row.state != "done"),
    )


def _average(label: str, keys: Sequence[str], scenes: Sequence[Scene]) -> Contender:
    found = {scene.name: next((c for c in scene.contenders if c.label == label), None) for scene in scenes}
    there = {name: contender for name, contender in found.items() if contender is not None}
    absent = Score(None, reason="not compared on this capture")

    def score(key: str) -> Score:
        scores = {name: absent if c is None else c.scores.get(key, absent) for name, c in found.items()}
        reasons = {score.reason for score in scores.values()}
        if len(reasons) == 1 and all(score.mean is None for score in scores.values()):
            return Score(None, reason=reasons.pop() or NOT_MEASURED)
        return Score.over_captures(scores)

    problems = [f"{name}: {contender.problem}" for name, contender in there.items() if contender.problem]
    whole = not problems and len(there) == len(scenes)
    return Contender(
        label=label,
        method=next(iter(there.values())).method,
        scores={key: score(key) for key in keys},
        training_seconds=Score.over_captures({name: c.training_seconds for name, c in there.items()}),
        evaluation_seconds=Score.over_captures({name: c.evaluation_seconds for name, c in there.items()}),
        problem="; ".join(problems) if len(problems) == len(there) else "",
        notes=() if whole else tuple(problems) + tuple(f"not compared on {n}" for n, c in found.items() if c is None),
    )
