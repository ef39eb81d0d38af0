"""How much memory there is, and how much rows take."""

from __future__ import annotations

import os
import resource
import sys
from pathlib import Path

import pytest

from dynhair.comparison import budget
from dynhair.comparison.budget import MemoryEstimates, available_memory, memory_budget, peak_memory, stated_memory
from dynhair.presets import PRESETS, preset

linux = pytest.mark.skipif(sys.platform != "linux", reason="the system does not say")
GB = 1_000_000_000


@linux
def test_the_peak_of_this_process_is_what_the_system_says() -> None:
    ours = peak_memory(os.getpid())
    assert ours == pytest.approx(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024, rel=0.02)


def test_a_process_that_is_gone_has_no_peak() -> None:
    assert peak_memory(2**30) is None


@linux
def test_a_container_allows_no_more_than_its_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = available_memory()
    monkeypatch.setattr(budget, "_CGROUP", tmp_path)
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "memory.current").write_text("700000000\n")
    (tmp_path / "memory.stat").write_text("anon 300000000\ninactive_file 400000000\n")
    assert available_memory() == pytest.approx(machine, rel=0.5)
    (tmp_path / "memory.max").write_text("500000000\n")
    assert available_memory() == 200_000_000


def test_a_budget_is_what_is_asked_for_or_a_share_of_what_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "available_memory", lambda: 10 * GB)
    assert memory_budget(None) == 8 * GB
    assert memory_budget(1.5) == 1_500_000_000


def test_the_stated_guess_covers_what_presets_were_measured_to_take() -> None:
    guesses = {name: stated_memory(config) / GB for name, config in PRESETS.items()}
    assert 1.8 < guesses["tiny"] < 2.5
    assert 6.4 * 1.074 <= guesses["paper"] < 9
    assert guesses["tiny"] < guesses["small"] < guesses["medium"] < guesses["paper"]


def test_a_measurement_takes_the_place_of_the_guess_for_its_kind() -> None:
    estimates = MemoryEstimates(stated_memory(preset("tiny")), {"gha": 1000})
    assert estimates("gha") == 1100
    assert estimates("ours") == stated_memory(preset("tiny"))
    estimates.measure("ours", 3000)
    estimates.measure("ours", 2000)
    assert estimates("ours") == 3300
