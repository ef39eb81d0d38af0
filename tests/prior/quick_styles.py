"""Stand-ins for the growth of hair, which has its own tests: strands that just stand off the scalp."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from dynhair.hairstyles import HeadField, Style
from dynhair.prior import dataset


def standing(style: Style, positions: Tensor, normals: Tensor, frame: object, field: object, points: int) -> Tensor:
    length = 0.02 + 0.1 * np.random.default_rng(style.seed).random()
    return positions[:, None] + torch.linspace(0, length, points)[:, None] * normals[:, None]


def no_field(vertices: Tensor, faces: Tensor) -> HeadField:
    return HeadField(torch.zeros(4, 2, 2, 2), torch.zeros(3), torch.ones(3))


def make_quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let sets be grown and rendered within a second."""
    monkeypatch.setattr(dataset, "grow_hairstyle", standing)
    monkeypatch.setattr(HeadField, "of", no_field)
    monkeypatch.setattr(dataset, "_VALIDATION_STYLES", 1)
    monkeypatch.setattr(dataset, "_IMAGE", 32)
