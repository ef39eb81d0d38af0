"""Which rows a comparison has, and what each of them needs first."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dynhair.comparison.methods import BASELINES, FULL, HAIR, LABELS, SIMULATORS, row_name
from dynhair.comparison.record import Comparison, Row
from dynhair.comparison.rows import SHARED, finished, trained
from dynhair.comparison.schedule import Task


def compared_rows(methods: Sequence[str], seeds: Sequence[int]) -> list[Row]:
    """Rows of methods, seed by seed; ours is one of them wherever a simulator needs it."""
    if SIMULATORS.intersection(methods) and "ours" not in methods:
        methods = ("ours", *methods)
    return _rows([(method, method) for method in methods], seeds)


def ablated_rows(ablations: Sequence[str], seeds: Sequence[int]) -> list[Row]:
    """Rows of the whole method and of the method without parts, seed by seed."""
    return _rows([(FULL, "ours"), *((name, name) for name in ablations)], seeds)


def _rows(methods: Iterable[tuple[str, str]], seeds: Sequence[int]) -> list[Row]:
    named, rows = dict(methods), []
    for seed in dict.fromkeys(seeds):
        if not BASELINES.issuperset(named.values()):
            name = row_name(HAIR, seed)
            rows.append(Row(name, LABELS[HAIR], HAIR, seed, f"{SHARED}/{name}"))
        for name, method in named.items():
            rows.append(Row(row_name(name, seed), LABELS[method], method, seed, row_name(name, seed)))
    return rows


def tasks(comparison: Comparison, names: Iterable[str]) -> list[Task]:
    """What is left to do of some rows, in an order in which each comes after what it needs.

    What others need comes first, so that nothing waits for long at the end.

    Args:
        comparison: that has the rows, and all that they need.
        names: of the rows to make.
    """
    rows = [comparison.rows[name] for name in names]
    left = {row.name: row for row in rows if not finished(comparison, row)}
    for row in list(left.values()):
        if row.method == HAIR and not _hair_is_missed(comparison, row, left.values()):
            del left[row.name]
    return [
        Task(row.name, _kind(row), tuple(need for need in _needs(row) if need in left))
        for row in sorted(left.values(), key=_rank)
    ]


def measured_memory(comparison: Comparison) -> dict[str, int]:
    """Bytes that the rows which are done took at most, by kind."""
    measured: dict[str, int] = {}
    for row in comparison.rows.values():
        if row.state == "done" and row.peak_memory is not None:
            measured[_kind(row)] = max(measured.get(_kind(row), 0), row.peak_memory)
    return measured


def _hair_is_missed(comparison: Comparison, hair: Row, rows: Iterable[Row]) -> bool:
    """Whether a row that is left has still to be trained from a hair."""
    return any(hair.name in _needs(row) and not trained(comparison, row) for row in rows)


def _needs(row: Row) -> tuple[str, ...]:
    if row.method in SIMULATORS:
        return (row_name("ours", row.seed),)
    return () if row.method == HAIR or row.method in BASELINES else (row_name(HAIR, row.seed),)


def _kind(row: Row) -> str:
    return row.method if row.method in BASELINES or row.method == HAIR else "ours"


def _rank(row: Row) -> tuple[int, int]:
    order = {HAIR: 0, "ours": 1}
    return order.get(row.method, 3 if row.method in SIMULATORS else 2), row.seed
