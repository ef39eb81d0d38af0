"""A comparison on disk: it comes back as it was, and refuses to be gone on with as another."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from stand_in import comparison_of

from dynhair.comparison.record import COMPARISON, Comparison
from dynhair.comparison.rows import begin
from dynhair.config import Config
from dynhair.errors import DynhairError
from dynhair.presets import preset


def changed(config: Config, **training: Any) -> Config:
    return dataclasses.replace(config, training=dataclasses.replace(config.training, **training))


def test_it_comes_back_as_it_was(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity", seeds=[0, 1])
    comparison.change("no-gravity-seed1", state="failed", error="on fire", seconds_trained=1.5, peak_memory=7)
    comparison.write()
    assert Comparison.read(tmp_path / "out") == comparison


def test_the_table_has_no_shared_rows(tmp_path: Path) -> None:
    comparison_of(tmp_path / "out", "no-gravity")
    value = json.loads((tmp_path / "out" / COMPARISON).read_text())
    assert value["kind"] == "dynhair comparison"
    assert value["table"] == "ablations"
    assert value["preset"] == "tiny"
    assert value["iterations"] == preset("tiny").training.iterations
    assert [(row["name"], row["method"]) for row in value["rows"]] == [
        ("full-seed0", "ours"),
        ("no-gravity-seed0", "no-gravity"),
    ]
    for row in value["rows"]:
        assert row["folder"] == row["name"]
        assert row["state"] == "pending"


def test_another_comparison_is_refused_and_what_differs_is_named(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity")
    comparison.require_same(dataclasses.replace(comparison, rows={}))
    other = dataclasses.replace(
        comparison, capture=Path("elsewhere"), config=changed(comparison.config, iterations=7, image_size=64)
    )
    with pytest.raises(DynhairError) as caught:
        comparison.require_same(other)
    message = str(caught.value)
    for difference in ("elsewhere", "training.iterations 1200 (asked for: 7)", "training.image_size 256"):
        assert difference in message
    assert "training.views" not in message


def test_a_precision_that_is_not_decided_agrees_with_any(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out")
    decided = dataclasses.replace(comparison, config=changed(comparison.config, precision="float32"))
    decided.require_same(comparison)
    with pytest.raises(DynhairError, match=r"training\.precision float32"):
        decided.require_same(dataclasses.replace(comparison, config=changed(comparison.config, precision="bfloat16")))


def test_a_run_of_other_settings_in_a_row_is_refused(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity")
    row = comparison.rows["no-gravity-seed0"]
    begin(comparison, row)
    comparison.config = changed(comparison.config, iterations=7)
    with pytest.raises(DynhairError, match=r"training\.iterations 1200 \(expected: 7\)"):
        begin(comparison, row)
    comparison.config, comparison.capture = preset("tiny"), tmp_path / "elsewhere"
    with pytest.raises(DynhairError, match="elsewhere"):
        begin(comparison, row)


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("precious")
    with pytest.raises(DynhairError, match="no comparison"):
        comparison_of(tmp_path / "out")
    assert [kept.name for kept in (tmp_path / "out").iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("content", ["{}", '{"kind": "dynhair comparison"}', "[]", "no JSON"])
def test_a_damaged_record_is_an_error(content: str, tmp_path: Path) -> None:
    comparison_of(tmp_path / "out")
    (tmp_path / "out" / COMPARISON).write_text(content)
    with pytest.raises(DynhairError, match=COMPARISON):
        Comparison.read(tmp_path / "out")
