"""A prior made from nothing, and its report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from quick_styles import make_quick
from rich.console import Console

from dynhair.errors import DynhairError
from dynhair.hairstyles import HELD_OUT
from dynhair.prior import making, training
from dynhair.prior.hair_prior import HairPrior
from dynhair.prior.making import make_prior
from dynhair.prior.report import VIEWS
from dynhair.storage import read_json


def test_views_are_judged_from_the_front_to_all_around() -> None:
    assert sorted(VIEWS) == [4, 8, 16, 28]
    assert all(len(set(views)) == count and set(VIEWS[4]) <= set(views) for count, views in VIEWS.items())


def test_numbers_that_make_no_prior_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="at least one"):
        make_prior(tmp_path, styles=0, steps=1, seed=0)


@pytest.mark.slow
def test_a_prior_is_made_and_reported_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_quick(monkeypatch)
    monkeypatch.setattr(training, "_BATCH", 1)
    monkeypatch.setattr(making, "_SAVES", 2)
    console = Console(quiet=True)
    prior = make_prior(tmp_path, styles=2, steps=2, seed=3, console=console)
    again = HairPrior.load(tmp_path / "hair_prior.safetensors")
    assert again.recipe == {"styles": 2, "steps": 2, "seed": 3, "basis": "points"} == prior.recipe
    report = read_json(tmp_path / "report" / "report.json")
    assert {row["family"] for row in report["encoders"]["held-out families"]} <= set(HELD_OUT)
    assert {row["views"] for row in report["encoders"]["known families"]} == set(VIEWS)
    assert all(np.isfinite(row["fine"]) for rows in report["encoders"].values() for row in rows)
    assert [entry["step"] for entry in report["course"]] == [1, 2]
    for name in ("basis", "encoders", "training", "hairstyles"):
        with Image.open(tmp_path / "report" / f"{name}.png") as picture:
            assert min(picture.size) > 100
    # More steps go on; with other hairstyles it is refused.
    make_prior(tmp_path, styles=2, steps=3, seed=3, console=console)
    assert [entry["step"] for entry in read_json(tmp_path / "course.json")["course"]] == [1, 2, 3]
    with pytest.raises(DynhairError, match="was begun with"):
        make_prior(tmp_path, styles=3, steps=3, seed=3, console=console)
