"""Compiled code takes what it was compiled for, and nothing else."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.native import Kernel, compiled, require_shapes


@pytest.fixture
def scaled(tmp_path: Path) -> Kernel:
    """Writes ``factor * given`` for the places ``[first, last)``."""
    source = tmp_path / "scaled.cpp"
    source.write_text("for (int k = first; k < last; ++k) result[k] = CHANNELS * given[k];\n", encoding="utf-8")
    return compiled(source, integers="first last", arrays="given:i32 result", channels=3)


def test_integers_arrays_and_the_constant_arrive(scaled: Kernel) -> None:
    result = torch.zeros(4)
    scaled(1, 3, torch.tensor([1, 2, 3, 4], dtype=torch.int32), result)
    assert result.tolist() == [0, 6, 9, 0]


def test_the_same_source_is_compiled_once(tmp_path: Path) -> None:
    source = tmp_path / "nothing.cpp"
    source.write_text("result[0] = 1.0f;\n", encoding="utf-8")
    with ThreadPoolExecutor(4) as pool:
        kernels = list(pool.map(lambda _: compiled(source, integers="", arrays="result"), range(4)))
    assert len({id(kernel) for kernel in kernels}) == 1
    result = torch.zeros(1)
    kernels[0](result)
    assert result.item() == 1


def test_other_tensors_are_refused(scaled: Kernel) -> None:
    given, result = torch.ones(4, dtype=torch.int32), torch.zeros(4)
    for wrong in (given.long(), given.float(), torch.ones(4, 2, dtype=torch.int32)[:, 0], given.to("meta")):
        with pytest.raises(AssertionError):
            scaled(0, 4, wrong, result)
    with pytest.raises(ValueError, match="zip"):
        scaled(0, 4, given)
    assert not result.any()


def test_other_shapes_are_refused() -> None:
    require_shapes(points=(torch.zeros(2, 3), (2, 3)), none=(torch.zeros(0), [0]))
    with pytest.raises(DynhairError, match=r"`points` has the shape \(2, 3\)\nexpected: \(3, 2\)"):
        require_shapes(points=(torch.zeros(2, 3), (3, 2)))
