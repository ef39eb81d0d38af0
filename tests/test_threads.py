"""Work on several threads."""

from __future__ import annotations

import threading

import pytest
import torch

from dynhair.threads import beside, keep_large_blocks, large_pieces, run, thread_count


def test_pytorch_is_held_to_one_thread_inside_the_block_only() -> None:
    before = torch.get_num_threads()
    with large_pieces():
        assert torch.get_num_threads() == 1
        assert thread_count() == before
        with large_pieces():
            assert thread_count() == before
    assert torch.get_num_threads() == thread_count() == before


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_task_runs_and_errors_come_out(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynhair.threads._own", threads)
    done: list[int] = []
    lock = threading.Lock()

    def task(number: int) -> None:
        with lock:
            done.append(number)

    run([lambda n=n: task(n) for n in range(20)])
    assert sorted(done) == list(range(20))
    run([])

    def failing() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run([failing, lambda: task(0)])


def test_keeping_blocks_does_no_harm() -> None:
    keep_large_blocks()
    assert torch.ones(1 << 20).sum() == 1 << 20


def test_work_beside_gives_its_result_and_its_error() -> None:
    assert beside(threading.get_ident)() != threading.get_ident()
    with pytest.raises(ZeroDivisionError):
        beside(lambda: 1 // 0)()
