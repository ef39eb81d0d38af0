"""The schedule never goes over its budgets, keeps the order of needs, and comes to an end."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynhair.comparison.schedule import Schedule, Task
from dynhair.errors import DynhairError

KINDS = ("a", "b", "c")


@dataclass(frozen=True)
class Case:
    tasks: tuple[tuple[str, str, tuple[str, ...]], ...]
    jobs: int
    memory: int
    sizes: dict[str, int]
    failing: frozenset[str]

    def schedule(self) -> Schedule:
        return Schedule([Task(*task) for task in self.tasks], self.jobs, self.memory, self.sizes.__getitem__)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    names = [f"t{number}" for number in range(draw(st.integers(0, 8)))]
    tasks = [
        (name, draw(st.sampled_from(KINDS)), tuple(draw(st.sets(st.sampled_from(names[:place]), max_size=2))))
        if place
        else (name, draw(st.sampled_from(KINDS)), ())
        for place, name in enumerate(names)
    ]
    return Case(
        tuple(tasks),
        draw(st.integers(1, 4)),
        draw(st.integers(1, 40)),
        {kind: draw(st.integers(1, 30)) for kind in KINDS},
        frozenset(draw(st.sets(st.sampled_from(names)))) if names else frozenset(),
    )


def play(case: Case, data: st.DataObject) -> tuple[Schedule, list[str], dict[str, str]]:
    """Run a schedule to its end, in any order of ends; checks every state on the way."""
    schedule = case.schedule()
    begun: list[str] = []
    reasons: dict[str, str] = {}
    for _ in range(4 * len(case.tasks) + 1):
        if schedule.finished:
            break
        reasons |= {task.name: reason for task, reason in schedule.refuse()}
        while task := schedule.begin():
            assert set(task.needs) <= schedule.done
            begun.append(task.name)
            assert len(schedule.reserved) <= case.jobs
            assert sum(schedule.reserved.values()) <= case.memory
        if schedule.reserved:
            name = data.draw(st.sampled_from(sorted(schedule.reserved)))
            schedule.finish(name, succeeded=name not in case.failing)
    return schedule, begun, reasons


@given(cases(), st.data())
def test_every_task_ends_once_within_the_budgets(case: Case, data: st.DataObject) -> None:
    schedule, begun, reasons = play(case, data)
    names = {name for name, _, _ in case.tasks}
    assert schedule.finished
    assert len(begun) == len(set(begun))
    assert set(begun) | set(reasons) == names
    assert not set(begun) & set(reasons)
    assert schedule.done | schedule.failed == names


@given(cases(), st.data())
def test_only_failed_needs_and_lack_of_memory_keep_a_task_back(case: Case, data: st.DataObject) -> None:
    schedule, begun, reasons = play(case, data)
    sizes = {name: case.sizes[kind] for name, kind, _ in case.tasks}
    needs = {name: set(wanted) for name, _, wanted in case.tasks}
    for name, reason in reasons.items():
        assert (needs[name] & schedule.failed) or sizes[name] > case.memory, reason
    for name in begun:
        assert sizes[name] <= case.memory


def test_a_task_that_grows_takes_room_from_those_that_wait() -> None:
    schedule = Schedule([Task("one", "a"), Task("two", "a")], 2, 20, lambda _: 10)
    assert schedule.begin() == Task("one", "a")
    schedule.observe("one", 11)
    schedule.observe("one", 3)
    assert schedule.begin() is None
    assert not schedule.refuse()
    schedule.finish("one", succeeded=True)
    assert schedule.begin() == Task("two", "a")


def test_small_tasks_overtake_what_does_not_fit() -> None:
    sizes = {"large": 15, "small": 5}
    tasks = [Task("first", "large"), Task("second", "large"), Task("third", "small")]
    schedule = Schedule(tasks, 3, 20, sizes.__getitem__)
    assert [task.name for task in iter(schedule.begin, None)] == ["first", "third"]


def test_what_is_learnt_of_memory_counts_at_once() -> None:
    sizes = {"a": 15}
    schedule = Schedule([Task("one", "a"), Task("two", "a"), Task("three", "a")], 3, 20, lambda kind: sizes[kind])
    assert [task.name for task in iter(schedule.begin, None)] == ["one"]
    sizes["a"] = 10
    schedule.finish("one", succeeded=True)
    assert [task.name for task in iter(schedule.begin, None)] == ["two", "three"]


@pytest.mark.parametrize(
    ("tasks", "said"),
    [
        ([Task("one", "a"), Task("one", "a")], "twice"),
        ([Task("one", "a", ("two",)), Task("two", "a")], "needs 'two'"),
    ],
)
def test_plans_that_cannot_be_are_refused(tasks: list[Task], said: str) -> None:
    with pytest.raises(DynhairError, match=said):
        Schedule(tasks, 1, 1, lambda _: 1)


def test_no_jobs_are_refused() -> None:
    with pytest.raises(DynhairError, match="0 jobs"):
        Schedule([], 0, 1, lambda _: 1)
