"""Tables filled in: cells as text, the best and the second of each column marked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from dynhair.report.columns import Column, Goal, Layout
from dynhair.report.comparison import OURS
from dynhair.report.scores import Contender, Scene

Mark = Literal["", "best", "second"]

MISSING = "n/a"


@dataclass(frozen=True)
class Cell:
    """One figure of one method.

    Attributes:
        text: the mean, rounded; ``n/a`` where there is none.
        spread: over seeds, rounded; empty where there is none.
        mark: among the column's values, as rounded.
        reason: why there is none.
        value: the mean, unrounded and unscaled.
        deviation: over seeds, likewise.
    """

    text: str
    spread: str = ""
    mark: Mark = ""
    reason: str = ""
    value: float | None = None
    deviation: float | None = None


@dataclass(frozen=True)
class Line:
    """One method.

    Attributes:
        label: of the method.
        ours: whether the others are held against it.
        seeds: most that any figure was averaged over.
        cells: one a column; none where the whole method has no figures.
        problem: why it has none.
        notes: on its seeds.
    """

    label: str
    ours: bool
    seeds: int
    cells: tuple[Cell, ...]
    problem: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """A filled table.

    Attributes:
        layout: its columns.
        scene: name of the capture.
        goals: one a column, for the truth at hand.
        lines: one a method.
        truth: the truth's own figures, one a column, empty where it has none; none where it has no figure at all.
    """

    layout: Layout
    scene: str
    goals: tuple[Goal, ...]
    lines: tuple[Line, ...]
    truth: tuple[str, ...]

    @property
    def title(self) -> str:
        """Above it."""
        return f"{self.layout.title}: {self.scene}"


def fill(layout: Layout, scene: Scene) -> Table | None:
    """Fill a table; None where it has no row but the method's own."""
    contenders = [contender for contender in scene.contenders if _belongs(layout, contender)]
    if all(contender.ours for contender in contenders):
        return None
    columns = [_column(column, contenders, scene) for column in layout.columns]
    lines = []
    for index, contender in enumerate(contenders):
        seeds = max((score.seeds for score in contender.scores.values()), default=0)
        cells = () if contender.problem else tuple(cells[index] for _, cells, _ in columns)
        lines.append(Line(contender.label, contender.ours, seeds, cells, contender.problem, contender.notes))
    truth = tuple(text for _, _, text in columns)
    return Table(layout, scene.name, tuple(goal for goal, _, _ in columns), tuple(lines), truth if any(truth) else ())


def merit(goal: Goal, value: float, truth: float | None) -> float:
    """How good a value is, for a goal that is not NONE; higher is better."""
    match goal:
        case Goal.HIGH:
            return value
        case Goal.LOW:
            return -value
        case Goal.TRUTH if truth is not None:
            return -abs(value - truth)
        case _:
            return -abs(value)


def marks(goal: Goal, shown: Sequence[str], truth: str) -> list[Mark]:
    """Mark the best and the second of some values as readers see them; equal ones share a mark.

    Args:
        goal: which values are good.
        shown: the values, or ``n/a``.
        truth: the truth's, empty where there is none.
    """
    target = float(truth) if truth else None
    if goal is Goal.NONE or (goal is Goal.TRUTH and target is None):
        return [""] * len(shown)
    # rounded once more: differences of rounded values are not exact
    merits = [None if text == MISSING else round(merit(goal, float(text), target), 9) for text in shown]
    order = sorted({value for value in merits if value is not None}, reverse=True)
    if sum(value is not None for value in merits) < 2:
        return [""] * len(shown)
    names: dict[float, Mark] = dict(zip(order, ("best", "second"), strict=False))
    return ["" if value is None else names.get(value, "") for value in merits]


def _belongs(layout: Layout, contender: Contender) -> bool:
    if contender.method == OURS:
        return True
    chosen = layout.methods is None or contender.method in layout.methods
    return chosen and contender.method not in layout.without


def _column(column: Column, contenders: Sequence[Contender], scene: Scene) -> tuple[Goal, list[Cell], str]:
    truth = scene.truths.get(column.key)
    goal = column.goal if truth is not None else column.goal_without_truth()
    scores = [contender.scores[column.key] for contender in contenders]
    means = [score.mean for score in scores if score.mean is not None]
    places = column.places(means)
    shown = [MISSING if score.mean is None else column.shown(score.mean, places) for score in scores]
    truth_text = "" if truth is None else column.shown(truth, places)
    cells = [
        Cell(
            text,
            "" if score.spread is None else column.shown(score.spread, places),
            mark,
            score.reason,
            score.mean,
            score.spread,
        )
        for text, score, mark in zip(shown, scores, marks(goal, shown, truth_text), strict=True)
    ]
    return goal, cells, truth_text
