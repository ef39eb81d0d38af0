"""Means over seeds and captures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_comparisons import made_comparison, made_row

from dynhair.report.comparison import Comparison
from dynhair.report.scores import Scene, Score

VALUES = st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=6)


def scene(folder: Path, capture: str, figures: dict[str, list[float | None]]) -> Scene:
    """A capture with the PSNR of each method's seeds."""
    rows = [
        made_row(folder / capture, method, {"psnr": value}, seed=seed)
        for method, values in figures.items()
        for seed, value in enumerate(values)
    ]
    return Scene.of(Comparison.open(made_comparison(folder / capture, rows, capture=capture)), capture)


@given(VALUES)
def test_seeds_are_averaged(values: list[float]) -> None:
    score = Score.over_seeds([None, *values], "")
    assert score.mean == pytest.approx(np.mean(values))
    assert score.spread == pytest.approx(np.std(values, ddof=1))
    assert score.seeds == len(values)


def test_one_seed_has_no_spread_and_none_has_a_reason() -> None:
    assert Score.over_seeds([2.0, None], "") == Score(2.0, None, 1)
    assert Score.over_seeds([None], "too dark") == Score(None, None, 0, "too dark")


@given(st.lists(st.tuples(st.floats(-10, 10), st.floats(0.01, 5)), min_size=2, max_size=4))
def test_the_spread_over_captures_is_that_of_a_mean_of_independent_figures(pairs: list[tuple[float, float]]) -> None:
    means, spreads = np.array(pairs).T
    score = Score.over_captures({str(i): Score(m, s, 3) for i, (m, s) in enumerate(pairs)})
    assert score.mean == pytest.approx(means.mean())
    weights = np.full(len(pairs), 1 / len(pairs))
    assert score.spread == pytest.approx(np.sqrt(weights @ np.diag(spreads**2) @ weights))


def test_rows_are_grouped_by_label(tmp_path: Path) -> None:
    ours, gha = scene(tmp_path, "long", {"ours": [20.0, 22.0], "gha": [19.0]}).contenders
    assert (ours.label, ours.ours, ours.scores["psnr"].mean, ours.scores["psnr"].seeds) == ("Ours", True, 21.0, 2)
    assert (gha.label, gha.ours, gha.scores["psnr"].spread) == ("GHA", False, None)
    assert ours.training_seconds.mean == 3725.0
    assert ours.evaluation_seconds.mean == 50.0


def test_a_method_keeps_the_seeds_that_did_not_fail(tmp_path: Path) -> None:
    rows = [
        made_row(tmp_path, "ours", {"psnr": 20.0}),
        made_row(tmp_path, "ours", {}, seed=1, state="failed", error="killed"),
    ]
    (ours,) = Scene.of(Comparison.open(made_comparison(tmp_path, rows)), "long").contenders
    assert ours.scores["psnr"] == Score(20.0, None, 1)
    assert (ours.problem, ours.notes) == ("", ("seed 1 failed: killed",))


def test_captures_are_averaged_where_all_have_the_figure(tmp_path: Path) -> None:
    scenes = [
        scene(tmp_path, "long", {"ours": [20.0], "gha": [10.0]}),
        scene(tmp_path, "curly", {"ours": [24.0], "gha": [None]}),
        scene(tmp_path, "bob", {"ours": [28.0]}),
    ]
    ours, gha = Scene.average(scenes).contenders
    assert ours.scores["psnr"].mean == 24.0
    assert gha.scores["psnr"].mean is None
    assert gha.scores["psnr"].reason == "curly: no reason; bob: not compared on this capture"
    assert gha.notes == ("not compared on bob",)


def test_the_truths_own_figures_come_from_any_row_that_has_them(tmp_path: Path) -> None:
    rows = [
        made_row(tmp_path, "gha", {"hair_tiou_truth": 0.9}),
        made_row(tmp_path, "ours", {"hair_tiou_truth": None, "ver_truth": 25.0}),
    ]
    truths = Scene.of(Comparison.open(made_comparison(tmp_path, rows)), "long").truths
    assert truths == {"hair_tiou": 0.9, "ver": 25.0}
