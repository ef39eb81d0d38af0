"""Rows at work, each in a process of its own, as many at once as cores and memory allow."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.live import Live
from rich.table import Table

from dynhair.comparison.budget import MemoryEstimates, peak_memory
from dynhair.comparison.record import Comparison
from dynhair.comparison.rows import LOG, begin, finished, trained
from dynhair.comparison.schedule import Schedule, Task
from dynhair.comparison.watching import Step, last_step, last_words, progress_table
from dynhair.errors import DynhairError

_TICK = 0.5  # seconds between two looks at the rows
_KEPT_EVERY = 60.0  # seconds between two writes of how long rows have trained

Command = Callable[[Path, str], Sequence[str]]


def row_command(path: Path, name: str) -> Sequence[str]:
    """The command that makes a row of a comparison."""
    return (sys.executable, "-m", "dynhair.comparison.row", str(path), name)


class Worker:
    """The process of one row.

    Args:
        command: what it runs.
        log: file that takes its output, after what earlier ones have left there.
        threads: that it may use.
        inherited: open files that it keeps open as long as it lives.
    """

    def __init__(self, command: Sequence[str], log: Path, threads: int, inherited: Sequence[int] = ()) -> None:
        self.log, self.began, self.peak = log, time.time(), 0
        environment = {
            **os.environ,
            "PYTHONUNBUFFERED": "1",
            "OMP_NUM_THREADS": str(threads),
            "OPENBLAS_NUM_THREADS": str(threads),
        }
        with log.open("ab") as output:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
                pass_fds=inherited,
                start_new_session=True,  # a Ctrl-C is passed on by `stop`, once
            )

    def poll(self) -> int | None:
        """The exit status, negative for a signal; None while it runs."""
        self.peak = max(self.peak, peak_memory(self._process.pid) or 0)
        return self._process.poll()

    def stop(self) -> None:
        """Ask the row to save and end."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    def kill(self) -> None:
        """End the row where it is."""
        self._process.kill()

    def wait(self) -> int:
        """Wait for the end."""
        return self._process.wait()


class Workers:
    """Makes the rows of a comparison, and keeps what becomes of them.

    Args:
        comparison: whose rows they are; it is written whenever a row ends.
        schedule: of the rows to make; its tasks have the rows' names.
        estimates: of memory, that are told what rows took.
        threads: that each row may use.
        console: where progress is shown.
        command: what makes a row.
        inherited: open files that rows keep open as long as they live.
        tick: seconds between two looks at the rows.
    """

    def __init__(
        self,
        comparison: Comparison,
        schedule: Schedule,
        estimates: MemoryEstimates,
        threads: int,
        console: Console,
        *,
        command: Command = row_command,
        inherited: Sequence[int] = (),
        tick: float = _TICK,
    ) -> None:
        self.comparison, self.schedule, self.estimates = comparison, schedule, estimates
        self.threads, self.console, self.command, self.inherited = threads, console, command, inherited
        self.tick = tick
        self._working: dict[str, tuple[Task, Worker]] = {}
        self._seen = self._kept = time.monotonic()

    def finish(self) -> None:
        """Make all rows; those that fail keep none of the others back.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed; the rows that ran have saved what they had.
        """
        try:
            with Live(
                console=self.console, auto_refresh=False, transient=True, redirect_stdout=False, redirect_stderr=False
            ) as live:
                while not self.schedule.finished:
                    self._refuse()
                    while task := self.schedule.begin():
                        self._begin(task)
                    if self.console.is_terminal:
                        live.update(self._table(), refresh=True)
                    time.sleep(self.tick if self._working else 0)
                    self._look()
        except KeyboardInterrupt:
            self._stop()
            raise
        finally:
            self.comparison.write()

    def _refuse(self) -> None:
        for task, reason in self.schedule.refuse():
            self._end(task.name, failed=reason)

    def _begin(self, task: Task) -> None:
        row = self.comparison.rows[task.name]
        try:
            begin(self.comparison, row)
            log = self.comparison.path / row.folder / LOG
            worker = Worker(self.command(self.comparison.path, row.name), log, self.threads, self.inherited)
        except (DynhairError, OSError) as error:
            self.schedule.finish(task.name, succeeded=False)
            self._end(task.name, failed=str(error))
            return
        self._working[task.name] = (task, worker)
        self._say(f"{row.name} begins")

    def _look(self) -> None:
        """See which rows have ended, and how long and how large the others are."""
        now = time.monotonic()
        passed, self._seen = now - self._seen, now
        for name, (task, worker) in list(self._working.items()):
            row = self.comparison.rows[name]
            if row.seconds_trained is not None and not trained(self.comparison, row):
                self.comparison.change(name, seconds_trained=row.seconds_trained + passed)
            status = worker.poll()
            if status is None:
                self.schedule.observe(name, worker.peak)
                continue
            del self._working[name]
            worker.stop()
            peak = max(worker.peak, row.peak_memory or 0) or None
            self.comparison.change(name, peak_memory=peak)
            succeeded = status == 0 and finished(self.comparison, row)
            if succeeded and peak is not None:
                self.estimates.measure(task.kind, peak)
            self.schedule.finish(name, succeeded=succeeded)
            self._end(name, failed=None if succeeded else _reason(status, worker.log))
        if now - self._kept > _KEPT_EVERY:
            self._kept = now
            self.comparison.write()

    def _end(self, name: str, *, failed: str | None) -> None:
        self.comparison.change(name, state="done" if failed is None else "failed", error=failed)
        self.comparison.write()
        self._say(f"{name} is done" if failed is None else f"{name} failed: {failed}")

    def _stop(self) -> None:
        """Let the rows that run save what they have; a second Ctrl-C ends them where they are."""
        self._say("Rows save what they have; press Ctrl-C again to leave them at their last checkpoints.")
        for _, worker in self._working.values():
            worker.stop()
        try:
            for _, worker in self._working.values():
                worker.wait()
        except KeyboardInterrupt:
            for _, worker in self._working.values():
                worker.kill()
                worker.wait()
        self._look_back()

    def _look_back(self) -> None:
        """Note the rows that ended well while they were being stopped."""
        for name in self._working:
            if finished(self.comparison, self.comparison.rows[name]):
                self.comparison.change(name, state="done", error=None)

    def _table(self) -> Table:
        return progress_table(self.comparison.rows.values(), {name: self._doing(name) for name in self._working})

    def _doing(self, name: str) -> tuple[str, Step | None]:
        row, worker = self.comparison.rows[name], self._working[name][1]
        if trained(self.comparison, row):
            return "evaluating", None
        return "beginning", last_step(worker.log, worker.began)

    def _say(self, message: str) -> None:
        self.console.print(message, highlight=False, markup=False, soft_wrap=True)


def _reason(status: int, log: Path) -> str:
    if status == 0:
        return "it ended without an evaluation"
    how = f"killed by signal {-status}" if status < 0 else f"exit status {status}"
    hint = ", which is what Linux does to processes when memory runs out" if status == -9 else ""
    return f"{how}{hint}; {log.name} ends with: {last_words(log)}"
