"""Reading comparisons: rows in any state, and folders that are none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_comparisons import made_comparison, made_row

from dynhair.errors import DynhairError
from dynhair.report.comparison import Comparison


def changed(folder: Path, **changes: Any) -> Path:
    path = folder / "comparison.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return folder


def test_rows_are_read_as_written(tmp_path: Path) -> None:
    rows = [made_row(tmp_path, "ours", {"psnr": 21.5, "flip": None}, seed=3, reasons={"flip": "too dark"})]
    comparison = Comparison.open(made_comparison(tmp_path, rows))
    (row,) = comparison.rows
    assert (comparison.capture, comparison.iterations, comparison.preset) == ("long", 1500, "small")
    assert (row.label, row.seed, row.state, row.problem, row.seconds) == ("Ours", 3, "done", "", 3725.0)
    assert row.figure("psnr") == 21.5
    assert row.figure("psnr", "nod") == 21.5
    assert row.figure("flip") is None
    assert row.reason("flip") == "too dark"
    assert row.test_segments == ["nod"]
    assert row.series()["nod/time"].shape == (8,)


def test_a_failed_row_says_why(tmp_path: Path) -> None:
    rows = [
        made_row(tmp_path, "ga", {}, state="failed", error="out of memory"),
        made_row(tmp_path, "gha", {}, state="pending"),
    ]
    failed, pending = Comparison.open(made_comparison(tmp_path, rows)).rows
    assert failed.problem == "failed: out of memory"
    assert pending.problem == "not run yet"


@pytest.mark.parametrize("damage", ["{", "[]", None])
def test_a_row_whose_figures_cannot_be_read_counts_as_failed(tmp_path: Path, damage: str | None) -> None:
    folder = made_comparison(tmp_path, [made_row(tmp_path, "ours", {"psnr": 20.0})])
    metrics = folder / "ours-seed0" / "evaluation" / "metrics.json"
    if damage is None:
        metrics.unlink()
    else:
        metrics.write_text(damage)
    (row,) = Comparison.open(folder).rows
    assert row.state == "failed"
    assert "metrics.json" in row.problem


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "dynhair run"}, "its kind is 'dynhair run'"),
        ({"table": "tables"}, "its table is 'tables'"),
        ({"rows": []}, "it has no rows"),
        ({"rows": [3]}, "a row is a JSON int"),
        ({"iterations": "many"}, "'iterations' is 'many'"),
        ({"capture": None}, "'capture' is None"),
    ],
)
def test_what_is_no_comparison_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    folder = changed(made_comparison(tmp_path, [made_row(tmp_path, "ours", {})]), **changes)
    with pytest.raises(DynhairError, match=message):
        Comparison.open(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"state": "finished"}, "the state of row 'ours-seed0' is 'finished'"),
        ({"folder": "../elsewhere"}, "lies at '../elsewhere'"),
        ({"folder": "/elsewhere"}, "lies at '/elsewhere'"),
        ({"label": ""}, "'label' is ''"),
        ({"seed": None}, "'seed' is None"),
    ],
)
def test_what_is_no_row_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    row = made_row(tmp_path, "ours", {}) | changes
    with pytest.raises(DynhairError, match=message):
        Comparison.open(made_comparison(tmp_path, [row]))


def test_a_folder_without_a_comparison_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="the file is missing"):
        Comparison.open(tmp_path)


def test_damaged_series_are_refused_and_never_unpickled(tmp_path: Path) -> None:
    (row,) = Comparison.open(made_comparison(tmp_path, [made_row(tmp_path, "ours", {})])).rows
    path = row.evaluation / "series.npz"
    path.write_bytes(b"PK not an archive")
    with pytest.raises(DynhairError, match="not readable as series"):
        row.series()
    np.savez(path, hidden=np.array([object()]))
    with pytest.raises(DynhairError, match="not readable as series"):
        row.series()
    path.unlink()
    assert row.series() == {}
