"""Strands of every kind that a file can hold, for Hypothesis."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from hypothesis import strategies as st

from dynhair.strands.files import StrandFile


@st.composite
def any_strands(draw: st.DrawFn, optional: tuple[str, ...] = ("widths", "transparencies", "colours")) -> StrandFile:
    """Any float32 bits but NaN and infinity, negative zero and denormals among them."""
    counts = torch.tensor(draw(st.lists(st.integers(1, 7), min_size=1, max_size=5)))
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def numbers(*shape: int) -> torch.Tensor:
        bits = generator.integers(0, 2**32, shape, dtype=np.uint32)
        values = bits.view(np.float32).copy()
        values[~np.isfinite(values)] = -0.0
        return torch.from_numpy(values)

    count = int(counts.sum())
    shapes = {"widths": (count,), "transparencies": (count,), "colours": (count, 3)}
    given = {name: numbers(*shapes[name]) for name in optional if draw(st.booleans())}
    return StrandFile(points=numbers(count, 3), counts=counts, **given)


def assert_same_bits(found: StrandFile, expected: StrandFile) -> None:
    for field in dataclasses.fields(StrandFile):
        left, right = getattr(found, field.name), getattr(expected, field.name)
        assert (left is None) == (right is None), field.name
        if left is not None:
            assert left.dtype == right.dtype, field.name
            assert left.shape == right.shape, field.name
            assert left.numpy().tobytes() == right.numpy().tobytes(), field.name
