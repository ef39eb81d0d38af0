"""Strands of different numbers of points."""

from __future__ import annotations

import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.strands import resample_strands
from dynhair.strands.files import StrandFile


def test_strands_are_resampled_as_each_would_be_alone() -> None:
    generator = torch.Generator().manual_seed(0)
    polylines = [torch.randn(count, 3, generator=generator) for count in (4, 2, 9, 4, 3)]
    strands = StrandFile(points=torch.cat(polylines), counts=torch.tensor([len(line) for line in polylines]))
    expected = torch.cat([resample_strands(line[None], 7) for line in polylines])
    torch.testing.assert_close(strands.resampled(7), expected, atol=0, rtol=0)


def test_strands_of_one_point_are_left_out() -> None:
    strands = StrandFile(points=torch.arange(12.0).view(4, 3), counts=torch.tensor([1, 2, 1]))
    torch.testing.assert_close(strands.resampled(2), torch.arange(3.0, 9.0).view(1, 2, 3))
    with pytest.raises(DynhairError, match="no strand has more than one point"):
        StrandFile(points=torch.zeros(2, 3), counts=torch.tensor([1, 1])).resampled(5)
