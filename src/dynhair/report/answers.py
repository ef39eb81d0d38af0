"""The answers of a blind study, summed up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text
from scipy.stats import binomtest

from dynhair.errors import DynhairError
from dynhair.storage import read_json

KEY_KIND = "dynhair user study key"
ANSWERS_KIND = "dynhair user study answers"
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Preference:
    """How often ours was preferred to one method.

    Attributes:
        question: its id.
        other: label of the other method.
        ours: answers for ours.
        answers: in all.
        low: end of the exact (Clopper and Pearson) interval of the share of answers for ours.
        high: its other end.
        p_value: two-sided, of the hypothesis that neither is preferred.
    """

    question: str
    other: str
    ours: int
    answers: int
    low: float
    high: float
    p_value: float

    @property
    def share(self) -> float:
        """Of the answers that are for ours."""
        return self.ours / self.answers


@dataclass(frozen=True)
class StudySummary:
    """What participants preferred; a console prints it as a table.

    Attributes:
        participants: how many.
        preferences: by question, then by method, in the order of the key.
        questions: their texts by id.
    """

    participants: int
    preferences: tuple[Preference, ...]
    questions: Mapping[str, str]

    def __rich__(self) -> Group:
        """Lay out one table."""
        table = Table(box=None, pad_edge=False, collapse_padding=True, header_style="bold")
        for heading in ("question", "ours or", "for ours", "share", f"{CONFIDENCE:.0%} interval", "p"):
            table.add_column(heading, justify="left" if heading in ("question", "ours or") else "right")
        for each in self.preferences:
            table.add_row(
                each.question,
                each.other,
                f"{each.ours} of {each.answers}",
                f"{each.share:.1%}",
                f"{each.low:.1%} to {each.high:.1%}",
                f"{each.p_value:.2g}",
            )
        notes = [Text(f"{name}: {text}", style="dim") for name, text in self.questions.items()]
        notes.append(
            Text(
                f"{self.participants} participants; exact binomial intervals and tests, which take all answers as "
                "independent, those of one participant too",
                style="dim",
            )
        )
        return Group(table, *notes)


def sum_user_study(answers: Sequence[Path], key: Path) -> StudySummary:
    """Count how often participants preferred ours, with exact binomial intervals.

    Args:
        answers: one file a participant, as the study's page gives it to them.
        key: ``user_study_key.json``, which lies beside that page.

    Raises:
        DynhairError: a file is damaged, answers belong to another study, or a participant comes twice.
    """
    secret = _read(key, KEY_KIND)
    if not answers:
        raise DynhairError("there are no answers", expected="one file a participant")
    questions = {str(question["id"]): str(question["text"]) for question in _list(secret, "questions", key)}
    trials = secret.get("trials")
    if not isinstance(trials, dict):
        raise DynhairError("it has no trials", path=key, expected="a key as `dynhair report` writes it")
    participants: dict[str, Path] = {}
    counts: dict[tuple[str, str], list[int]] = {}
    for path in answers:
        given = _read(path, ANSWERS_KIND)
        if given.get("study") != secret.get("study"):
            raise DynhairError(
                f"its answers are of the study {given.get('study')!r}",
                path=path,
                expected=f"{secret.get('study')!r}, the study of {key}",
            )
        participant = str(given.get("participant"))
        if participant in participants:
            raise DynhairError(
                f"participant '{participant}' has answered in {participants[participant]} already", path=path
            )
        participants[participant] = path
        for trial, question, ours in _choices(given, trials, questions, path):
            tally = counts.setdefault((question, str(trials[trial]["label"])), [0, 0])
            tally[0] += ours
            tally[1] += 1
    methods = dict.fromkeys(str(trial["label"]) for trial in trials.values())
    preferences = [
        _preference(question, method, *counts[question, method])
        for question in questions
        for method in methods
        if (question, method) in counts
    ]
    return StudySummary(len(participants), tuple(preferences), questions)


def _preference(question: str, other: str, ours: int, answers: int) -> Preference:
    test = binomtest(ours, answers)
    interval = test.proportion_ci(CONFIDENCE, method="exact")
    return Preference(question, other, ours, answers, float(interval.low), float(interval.high), float(test.pvalue))


def _choices(
    given: Mapping[str, Any], trials: Mapping[str, Any], questions: Mapping[str, str], path: Path
) -> list[tuple[str, str, bool]]:
    """Trial, question, and whether ours was chosen, of each answer of one participant."""
    choices: dict[tuple[str, str], bool] = {}
    for answer in _list(given, "answers", path):
        trial, question, chosen = (str(answer.get(name)) for name in ("trial", "question", "chosen"))
        if trial not in trials or question not in questions:
            raise DynhairError(f"no trial {trial!r} with a question {question!r} is in the key", path=path)
        ours, other = (trials[trial].get(name) for name in ("ours", "other"))
        if chosen not in (ours, other):
            raise DynhairError(f"trial '{trial}' has no clip {chosen!r}", path=path, expected=f"{ours!r} or {other!r}")
        if (trial, question) in choices:
            raise DynhairError(f"trial '{trial}' answers '{question}' twice", path=path)
        choices[trial, question] = chosen == ours
    return [(trial, question, ours) for (trial, question), ours in choices.items()]


def _read(path: Path, kind: str) -> dict[str, Any]:
    raw = read_json(path)
    if raw.get("kind") != kind:
        raise DynhairError(f"its kind is {raw.get('kind')!r}", path=path, expected=repr(kind))
    return raw


def _list(raw: Mapping[str, Any], name: str, path: Path) -> list[dict[str, Any]]:
    value = raw.get(name)
    if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
        raise DynhairError(f"'{name}' is not a list of JSON objects", path=path)
    return value
