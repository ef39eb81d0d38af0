"""What the benchmarks measure, for every preset's kind of hair motion."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dynhair.capture import Capture
from dynhair.config import DeformerKind, HairConfig, with_deformer
from dynhair.presets import PRESETS
from synthetic import write_synthetic_capture

UNTRAINED = Path(__file__).parents[2] / "benchmarks" / "untrained.py"


@pytest.mark.parametrize("kind", ["paper", "modal", "strands"])
def test_an_untrained_avatar_moves_its_hair(kind: DeformerKind, tmp_path: Path) -> None:
    write_synthetic_capture(tmp_path / "capture", frames=4, views=2, with_gt=False)
    capture = Capture.open(tmp_path / "capture")
    tiny = with_deformer(PRESETS["tiny"], kind)
    config = replace(tiny, hair=HairConfig(20, 8, deformer=tiny.hair.deformer))
    avatar = runpy.run_path(str(UNTRAINED))["started"](capture, config).avatar
    strands = avatar.pose(capture.track(capture.segments[0]), 3).strands
    assert strands.shape == (20, 8, 3)
    assert torch.isfinite(strands).all()
