"""Rows, what they share, and what each needs first."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from stand_in import comparison_of

from dynhair.ablations import ABLATIONS
from dynhair.comparison.methods import LABELS, changes_nothing, method_config, row_name
from dynhair.comparison.plan import ablated_rows, compared_rows, measured_memory, tasks
from dynhair.comparison.record import Comparison
from dynhair.comparison.rows import begin, shared_files
from dynhair.comparison.run import METHODS
from dynhair.comparison.schedule import Schedule
from dynhair.presets import preset


@given(st.lists(st.sampled_from(METHODS), min_size=1, unique=True), st.lists(st.integers(0, 3), min_size=1))
def test_tasks_of_any_methods_and_seeds_come_after_what_they_need(methods: list[str], seeds: list[int]) -> None:
    rows = {row.name: row for row in compared_rows(methods, seeds)}
    comparison = Comparison(Path("nowhere"), "baselines", Path("capture"), "tiny", preset("tiny"), rows)
    planned = tasks(comparison, rows)
    Schedule(planned, 1, 1, lambda _: 1)  # refuses what comes before its needs
    assert {task.name for task in planned} == set(rows)
    for seed in seeds:
        assert {row_name(method, seed) for method in methods} <= set(rows)


def test_one_hair_serves_all_rows_of_a_seed() -> None:
    rows = ablated_rows(["no-gravity", "rigid"], [0, 3])
    assert [row.name for row in rows] == [
        *("hair-seed0", "full-seed0", "no-gravity-seed0", "rigid-seed0"),
        *("hair-seed3", "full-seed3", "no-gravity-seed3", "rigid-seed3"),
    ]
    comparison = Comparison(Path("nowhere"), "ablations", Path("c"), "tiny", preset("tiny"), {r.name: r for r in rows})
    needs = {task.name: task.needs for task in tasks(comparison, comparison.rows)}
    assert needs["hair-seed3"] == ()
    assert needs["full-seed3"] == needs["rigid-seed3"] == ("hair-seed3",)


def test_simulators_bring_ours_along_and_gaussians_need_no_hair() -> None:
    assert [row.name for row in compared_rows(["gha", "ga"], [1])] == ["gha-seed1", "ga-seed1"]
    names = [row.name for row in compared_rows(["simulator"], [1])]
    assert names == ["hair-seed1", "ours-seed1", "simulator-seed1"]


def test_every_method_and_ablation_has_a_label() -> None:
    assert set(LABELS) == {*METHODS, *ABLATIONS, "hair"}
    assert len(set(LABELS.values())) == len(LABELS)


def test_the_stages_that_rows_share_have_the_same_settings_in_all_of_them() -> None:
    for name in ("small", "paper"):
        base = preset(name)
        for ablation in ABLATIONS:
            config = method_config(base, ablation, 0)
            assert (config.static, config.hair.strands, config.hair.points) == (
                base.static,
                base.hair.strands,
                base.hair.points,
            )
            assert (config.mesh, config.head) == (base.mesh, base.head)
    assert "mesh_head.safetensors" in shared_files(preset("paper"))
    assert "mesh_head.safetensors" not in shared_files(preset("small"))


def test_what_a_preset_does_not_have_cannot_be_taken_away() -> None:
    of_the_papers_deformer = ["pose", "no-elastic", "no-film", "mlp-encoder"]
    absent = [name for name in ABLATIONS if changes_nothing(preset("tiny"), name)]
    assert absent == [*of_the_papers_deformer, "no-raised-perceptual", "no-reach"]
    assert [name for name in ABLATIONS if changes_nothing(preset("small"), name)] == of_the_papers_deformer
    ours = [name for name in ABLATIONS if changes_nothing(preset("paper"), name)]
    assert ours == ["paper-deformer", "untaught", "no-turn", "stretching", "no-reach"]


def test_rows_begin_with_the_shared_hair_and_settings_of_their_own(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity", seeds=[2])
    hair, _, without = comparison.rows.values()
    begin(comparison, hair)
    for name in ("canonical_hair", "first_guess"):
        (comparison.folder(hair.name) / f"{name}.safetensors").write_text(name)
    begin(comparison, without)
    begin(comparison, without)
    folder = comparison.folder("no-gravity-seed2")
    assert (folder / "canonical_hair.safetensors").read_text() == "canonical_hair"
    text = (folder / "config.yaml").read_text()
    assert "gravity: false" in text
    assert "seed: 2" in text


def test_memory_is_remembered_by_kind(tmp_path: Path) -> None:
    comparison = comparison_of(tmp_path / "out", "no-gravity", "rigid")
    comparison.change("hair-seed0", state="done", peak_memory=900)
    comparison.change("full-seed0", state="done", peak_memory=100)
    comparison.change("no-gravity-seed0", state="done", peak_memory=300)
    comparison.change("rigid-seed0", state="failed", peak_memory=500)
    assert measured_memory(comparison) == {"hair": 900, "ours": 300}
