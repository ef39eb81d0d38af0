from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import pytest

from dynhair.preprocess.jobs import Job, for_each, is_fresh, record_settings


def _file(path: Path, seconds: int) -> Path:
    path.write_text("x")
    os.utime(path, (seconds, seconds))
    return path


def test_outputs_are_fresh_unless_missing_or_older_than_an_input(tmp_path: Path) -> None:
    old, middle, new = (_file(tmp_path / name, time) for name, time in (("a", 10), ("b", 20), ("c", 30)))
    assert is_fresh([middle], [old])
    assert is_fresh([middle], [middle])
    assert is_fresh([middle], [tmp_path / "gone"])
    assert not is_fresh([middle], [old, new])
    assert not is_fresh([old, new], [middle])
    assert not is_fresh([new, tmp_path / "gone"], [old])


def test_changed_settings_make_outputs_stale_and_the_same_settings_do_not(tmp_path: Path) -> None:
    record = tmp_path / "step.json"
    assert record_settings(record, {"size": [1, 2]})
    os.utime(record, (10, 10))
    job = Job("view", (_file(tmp_path / "in", 5),), (_file(tmp_path / "out", 20),))
    assert not record_settings(record, {"size": [1, 2]})
    assert job.is_fresh(record)
    assert record_settings(record, {"size": [1, 3]})
    assert not job.is_fresh(record)


def test_a_damaged_record_is_replaced(tmp_path: Path) -> None:
    record = tmp_path / "step.json"
    record.write_text('{"size"')
    assert record_settings(record, {"size": 1})
    assert not record_settings(record, {"size": 1})


def test_each_thread_makes_one_worker_and_every_item_is_done_once() -> None:
    made, seen, counts, lock = [], [], [], threading.Lock()

    def make_worker():
        made.append(threading.get_ident())

        def work(item: int) -> None:
            with lock:
                seen.append(item)

        return work

    for_each(range(50), make_worker, counts.append)
    assert sorted(seen) == list(range(50))
    assert len(made) == len(set(made))
    assert counts == list(range(1, 51))


def test_an_error_stops_the_rest(tmp_path: Path) -> None:
    seen = []

    def work(item: int) -> None:
        seen.append(item)
        time.sleep(0.005)  # else all may be done before the first error is noticed
        raise ValueError("bad view")

    with pytest.raises(ValueError, match="bad view"):
        for_each(range(1000), lambda: work, lambda count: None)
    assert len(seen) < 1000


def test_nothing_to_do() -> None:
    for_each([], lambda: lambda item: None, lambda count: pytest.fail("nothing is done"))


def test_a_single_job_is_done_in_the_calling_thread() -> None:
    threads = []
    for_each([1], lambda: lambda item: threads.append(threading.get_ident()), lambda count: None)
    assert threads == [threading.get_ident()], "Ctrl-C reaches it there"
