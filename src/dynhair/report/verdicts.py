"""Where another method is better than ours, and where ours is the best, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dynhair.report.columns import Column, Goal, figures_of
from dynhair.report.scores import Contender, Scene, Score
from dynhair.report.tables import merit

_OF_GOAL = {
    Goal.HIGH: "higher is better",
    Goal.LOW: "lower is better",
    Goal.ZERO: "nearer to zero is better",
    Goal.TRUTH: "nearer to the truth is better",
}


_WORTH = {
    True: "more than the spread over seeds",
    False: "within the spread over seeds",
    None: "of one seed, so that the spread is unknown",
}


@dataclass(frozen=True)
class Finding:
    """One figure, and who is ahead in it.

    Attributes:
        figure: its name.
        sentence: who is ahead of whom, by how much, and what that is worth.
        beyond_spread: whether a difference exceeds the spreads of both over seeds, added; None where none is
            known.
    """

    figure: str
    sentence: str
    beyond_spread: bool | None


@dataclass(frozen=True)
class Verdicts:
    """What the figures of a scene say of ours.

    Attributes:
        behind: figures in which another method is better than ours.
        ahead: figures in which ours is better than every other method that has them.
        level: names of the figures in which the best other method shows the same value as ours.
        missing: names of the figures that could not be compared, and why.
    """

    behind: tuple[Finding, ...]
    ahead: tuple[Finding, ...]
    level: tuple[str, ...]
    missing: tuple[tuple[str, str], ...]


def judge(scene: Scene) -> Verdicts:
    """Hold every other method against ours, figure by figure, in the order of the tables."""
    ours = next((contender for contender in scene.contenders if contender.ours), None)
    others = [contender for contender in scene.contenders if not contender.ours]
    behind, ahead, level, missing = [], [], [], []
    for column in figures_of(scene.table):
        truth = scene.truths.get(column.key)
        goal = column.goal if truth is not None else column.goal_without_truth()
        score = None if ours is None else ours.scores[column.key]
        rivals = [other for other in others if other.scores[column.key].mean is not None]
        if ours is None or score is None or score.mean is None or not rivals or goal is Goal.NONE:
            missing.append((column.name, _why_missing(column, ours, others)))
            continue
        places = column.places([score.mean, *_means(rivals, column)])
        margins = [(_margin(column, goal, places, score, rival, truth), rival) for rival in rivals]
        scale = _Scale(column, goal, places, truth)
        leads = sorted(((-margin, rival) for margin, rival in margins if margin < 0), key=lambda lead: -lead[0])
        if leads:
            behind.append(scale.behind(ours, leads))
            continue
        closest, rival = min(margins, key=lambda lead: lead[0])
        if closest > 0:
            ahead.append(scale.ahead(ours, rival, closest))
        else:
            level.append(column.name)
    return Verdicts(tuple(behind), tuple(ahead), tuple(level), tuple(missing))


def _means(contenders: Sequence[Contender], column: Column) -> list[float]:
    return [mean for contender in contenders if (mean := contender.scores[column.key].mean) is not None]


def _margin(column: Column, goal: Goal, places: int, ours: Score, rival: Contender, truth: float | None) -> float:
    """By how much ours is better, of the values as they are shown."""

    def rounded(value: float) -> float:
        return float(column.shown(value, places))

    aim = None if truth is None else rounded(truth)
    assert ours.mean is not None
    (theirs,) = _means([rival], column)
    return round(merit(goal, rounded(ours.mean), aim) - merit(goal, rounded(theirs), aim), 9)


@dataclass(frozen=True)
class _Scale:
    """How one figure is put into words."""

    column: Column
    goal: Goal
    places: int
    truth: float | None

    def behind(self, ours: Contender, leads: Sequence[tuple[float, Contender]]) -> Finding:
        """Others are better, by the margins of ``leads``."""
        worths = [self._beyond_spread(margin, rival, ours) for margin, rival in leads]
        parts = [
            f"{rival.label} {self._value(rival)} is better by {self._margin(margin)}, {_WORTH[worth]}"
            for (margin, rival), worth in zip(leads, worths, strict=True)
        ]
        beyond = True if any(worths) else None if None in worths else False
        return Finding(self.column.name, f"{self._own(ours)}. {'; '.join(parts)}.", beyond)

    def ahead(self, ours: Contender, rival: Contender, margin: float) -> Finding:
        """Ours is better than all, and than the next by ``margin``."""
        worth = self._beyond_spread(margin, ours, rival)
        sentence = (
            f"{self._own(ours)}. Better than the next, {rival.label} {self._value(rival)}, by {self._margin(margin)}, "
            f"{_WORTH[worth]}."
        )
        return Finding(self.column.name, sentence, worth)

    def _own(self, ours: Contender) -> str:
        aim = ""
        if self.goal is Goal.TRUTH and self.truth is not None:
            aim = f"; the truth has {self.column.shown(self.truth, self.places)}"
        return f"{ours.label} {self._value(ours)} ({_OF_GOAL[self.goal]}{aim})"

    def _margin(self, margin: float) -> str:
        return f"{margin:.{self.places}f}" + self._unit

    def _value(self, contender: Contender) -> str:
        score = contender.scores[self.column.key]
        assert score.mean is not None
        mean = self.column.shown(score.mean, self.places)
        spread = "" if score.spread is None else f" ± {self.column.shown(score.spread, self.places)}"
        return mean + spread + self._unit

    @property
    def _unit(self) -> str:
        return f" {self.column.unit}" if self.column.unit else ""

    def _beyond_spread(self, margin: float, *contenders: Contender) -> bool | None:
        scores = [contender.scores[self.column.key] for contender in contenders]
        spreads = [score.spread for score in scores if score.spread is not None]
        return margin / self.column.scale > sum(spreads) if spreads else None


def _why_missing(column: Column, ours: Contender | None, others: Sequence[Contender]) -> str:
    if ours is None:
        return "the comparison has no row of our method"
    if ours.scores[column.key].mean is None:
        return f"{ours.label}: {ours.scores[column.key].reason}"
    scores = {other.label: other.scores[column.key] for other in others}
    reasons = [f"{label}: {score.reason}" for label, score in scores.items() if score.reason]
    return "; ".join(reasons) or "the truth's own figure is unknown"
