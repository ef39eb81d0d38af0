"""Which task may run now, within a number of tasks at once and a budget of memory. No clock and no processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dynhair.errors import DynhairError


@dataclass(frozen=True)
class Task:
    """A piece of work.

    Attributes:
        name: its own.
        kind: tasks of one kind take about as much memory.
        needs: names of the tasks that must be done before.
    """

    name: str
    kind: str
    needs: tuple[str, ...] = ()


class Schedule:
    """Tasks that wait, run, are done or have failed.

    Earlier tasks come first; where one does not fit, a later one that does may overtake it. As long as tasks wait and
    none runs, either :meth:`begin` gives one or :meth:`refuse` takes one away, so that it comes to an end.

    Args:
        tasks: each after those that it needs.
        jobs: how many may run at once.
        memory: bytes that all that run may take together.
        estimate: bytes that a task of a kind is expected to take; may change as more is known.

    Raises:
        DynhairError: a name comes twice, or a task needs one that does not come before it.
    """

    def __init__(self, tasks: Sequence[Task], jobs: int, memory: int, estimate: Callable[[str], int]) -> None:
        if jobs < 1:
            raise DynhairError(f"{jobs} jobs", expected="1 or more")
        known: set[str] = set()
        for task in tasks:
            missing = [name for name in task.needs if name not in known]
            if task.name in known or missing:
                raise DynhairError(
                    f"task '{task.name}' " + (f"needs '{missing[0]}', not there before it" if missing else "twice")
                )
            known.add(task.name)
        self.jobs, self.memory, self.estimate = jobs, memory, estimate
        self.waiting = list(tasks)
        self.reserved: dict[str, int] = {}
        self.done: set[str] = set()
        self.failed: set[str] = set()

    @property
    def finished(self) -> bool:
        """Whether nothing waits and nothing runs."""
        return not self.waiting and not self.reserved

    def begin(self) -> Task | None:
        """Take the next task that may run now; None if there is none at present."""
        if len(self.reserved) >= self.jobs:
            return None
        free = self.memory - sum(self.reserved.values())
        for task in self.waiting:
            wanted = self.estimate(task.kind)
            if wanted <= free and self.done.issuperset(task.needs):
                self.waiting.remove(task)
                self.reserved[task.name] = wanted
                return task
        return None

    def observe(self, name: str, memory: int) -> None:
        """Tell how much memory a running task has taken at most: more than was expected is not free for others."""
        self.reserved[name] = max(self.reserved[name], memory)

    def finish(self, name: str, *, succeeded: bool) -> None:
        """Tell that a running task has ended."""
        del self.reserved[name]
        (self.done if succeeded else self.failed).add(name)

    def refuse(self) -> list[tuple[Task, str]]:
        """Take away, as failed, the tasks that can never run; with the reason in words."""
        refused = []
        for task in list(self.waiting):
            lost = [name for name in task.needs if name in self.failed]
            wanted = self.estimate(task.kind)
            if lost:
                reason = f"it needs {lost[0]}, which failed"
            elif not self.reserved and wanted > self.memory:
                reason = (
                    f"it would take about {wanted / 1e9:.1f} GB of memory, and may take {self.memory / 1e9:.1f} GB: "
                    "free some memory, or allow more by --memory"
                )
            else:
                continue
            self.waiting.remove(task)
            self.failed.add(task.name)
            refused.append((task, reason))
        return refused
