"""Comparisons and ablations from their calls: what is trained, what is kept, what is refused."""

from __future__ import annotations

import dataclasses
import io
import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from rich.console import Console
from stand_in import order, stand_in, states

import dynhair.report
from dynhair.comparison.folder_lock import locked
from dynhair.comparison.options import RowOptions
from dynhair.comparison.record import COMPARISON, Comparison
from dynhair.comparison.run import run_ablation, run_comparison
from dynhair.errors import DynhairError
from dynhair.presets import preset
from dynhair.training.run import Run
from synthetic import write_synthetic_capture


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_synthetic_capture(tmp_path_factory.mktemp("data") / "capture", frames=2, views=2, size=16)


@pytest.fixture
def reports(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    written: list[Path] = []

    def write_report(folders: Sequence[Path], out: Path, console: Console | None = None) -> Path:
        written.append(out)
        return out / "index.html"

    monkeypatch.setattr(dynhair.report, "write_report", write_report)
    return written


def quiet() -> Console:
    return Console(file=io.StringIO(), width=200)


def ablate(capture: Path, out: Path, *rows: str, seeds: Sequence[int] = (0,), console: Console | None = None) -> bool:
    chosen = rows or ("no-gravity",)
    return run_ablation(
        capture,
        out,
        RowOptions("tiny", iterations=9, seeds=tuple(seeds), jobs=2, memory=8.0),
        rows=chosen,  # pyright: ignore[reportArgumentType]
        console=console or quiet(),
        command=stand_in,
    )


def compare(
    capture: Path,
    out: Path,
    methods: Sequence[str],
    avatar: Path | None = None,
    drivers: Sequence[Path] = (),
    **options: object,
) -> bool:
    options = {"preset": "tiny", "jobs": 2, "memory": 8.0, **options}
    return run_comparison(
        capture,
        out,
        RowOptions(**options),  # pyright: ignore[reportArgumentType]
        methods=methods,  # pyright: ignore[reportArgumentType]
        avatar=avatar,
        drivers=drivers,
        console=quiet(),
        command=stand_in,
    )


def trained_run(capture: Path, path: Path, seed: int = 4) -> Path:
    """A run that has an avatar, with a configuration of its own."""
    training = dataclasses.replace(preset("small").training, seed=seed, iterations=77, precision="float32")
    run = Run.create(path, capture, dataclasses.replace(preset("small"), training=training))
    for name in ("canonical_hair", "first_guess"):
        (path / f"{name}.safetensors").write_text(f"{name} of the run")
    run.avatar.mkdir()
    (run.avatar / "avatar.json").write_text('{"of": "the run"}')
    return path


def test_rows_and_seeds_can_be_added(capture: Path, tmp_path: Path, reports: list[Path]) -> None:
    out = tmp_path / "out"
    assert ablate(capture, out, "no-gravity")
    (out / "full-seed0" / "begun").unlink()
    assert ablate(capture, out, "rigid", seeds=[0, 1])
    assert states(out) == {
        **dict.fromkeys(("hair-seed0", "full-seed0", "no-gravity-seed0", "rigid-seed0"), "done"),
        **dict.fromkeys(("hair-seed1", "full-seed1", "rigid-seed1"), "done"),
    }
    assert not (out / "full-seed0" / "begun").exists()
    assert reports == [out / "report", out / "report"]


def test_a_failure_is_told_and_reported(capture: Path, tmp_path: Path, reports: list[Path]) -> None:
    out = tmp_path / "out"
    order(out, "no-gravity-seed0", "fail")
    assert not ablate(capture, out)
    assert len(reports) == 1
    order(out, "no-gravity-seed0", "")
    assert ablate(capture, out)


def test_a_record_that_lags_behind_the_folders_is_brought_up_to_date(
    capture: Path, tmp_path: Path, reports: list[Path]
) -> None:
    out = tmp_path / "out"
    assert ablate(capture, out)
    value = json.loads((out / COMPARISON).read_text())
    for row in [*value["rows"], *value["shared"]]:
        row["state"] = "pending"
        (out / row["folder"] / "begun").unlink()
    (out / COMPARISON).write_text(json.dumps(value))
    assert ablate(capture, out)
    assert set(states(out).values()) == {"done"}
    assert not list(out.glob("**/begun"))


def test_a_row_whose_folder_is_deleted_is_made_again(capture: Path, tmp_path: Path, reports: list[Path]) -> None:
    out = tmp_path / "out"
    assert ablate(capture, out)
    comparison = Comparison.read(out)
    comparison.change("no-gravity-seed0", seconds_trained=1e6)
    comparison.write()
    shutil.rmtree(out / "no-gravity-seed0")
    assert ablate(capture, out)
    row = Comparison.read(out).rows["no-gravity-seed0"]
    assert row.state == "done"
    assert row.seconds_trained is not None
    assert row.seconds_trained < 1000


def test_another_comparison_in_the_folder_is_refused_by_name(
    capture: Path, tmp_path: Path, reports: list[Path]
) -> None:
    out = tmp_path / "out"
    assert ablate(capture, out)
    with pytest.raises(DynhairError, match=r"table ablations \(asked for: baselines\)"):
        compare(capture, out, ["ours"], iterations=9)
    with pytest.raises(DynhairError, match=r"training\.iterations 9 \(asked for: 8\)"):
        run_ablation(capture, out, RowOptions("tiny", iterations=8), console=quiet(), command=stand_in)


def test_an_ablation_of_what_the_preset_does_not_have_is_left_out(
    capture: Path, tmp_path: Path, reports: list[Path]
) -> None:
    console = quiet()
    assert ablate(capture, tmp_path / "out", "no-gravity", "no-raised-perceptual", console=console)
    assert "no-raised-perceptual-seed0" not in states(tmp_path / "out")
    assert isinstance(console.file, io.StringIO)
    assert "no-raised-perceptual is left out" in console.file.getvalue()


def test_a_trained_run_is_ours_and_sets_the_terms(capture: Path, tmp_path: Path, reports: list[Path]) -> None:
    out, run = tmp_path / "out", trained_run(capture, tmp_path / "run")
    for _ in range(2):
        assert compare(capture, out, ["rigid", "gha"], run, seeds=(4,))
    assert states(out) == {
        "hair-seed4": "done",
        "ours-seed4": "done",
        "rigid-seed4": "done",
        "gha-seed4": "done",
    }
    value = json.loads((out / COMPARISON).read_text())
    assert (value["preset"], value["iterations"]) == ("small", 77)
    ours = next(row for row in value["rows"] if row["method"] == "ours")
    assert ours["seconds_trained"] is None
    assert "iterations: 77" in (out / "gha-seed4" / "config.yaml").read_text()
    for name in ("ours-seed4", "rigid-seed4"):
        assert (out / name / "canonical_hair.safetensors").read_text() == "canonical_hair of the run"
    assert not (out / "shared" / "hair-seed4" / "begun").exists()
    assert not (run / "evaluation").exists()


def test_a_run_that_is_no_match_is_refused(capture: Path, tmp_path: Path) -> None:
    run = trained_run(capture, tmp_path / "run")
    other = write_synthetic_capture(tmp_path / "other", frames=2, views=2, size=16)
    for message, shown, options in (
        ("seed is 4", capture, {}),
        ("trained for 77 steps", capture, {"seeds": (4,), "iterations": 5}),
        ("was trained on", other, {"seeds": (4,)}),
    ):
        with pytest.raises(DynhairError, match=message):
            compare(shown, tmp_path / "out", ["ours"], run, (), **options)
    (run / "avatar" / "avatar.json").unlink()
    with pytest.raises(DynhairError, match="no avatar yet"):
        compare(capture, tmp_path / "out", ["ours"], run, seeds=(4,))
    assert not (tmp_path / "out").exists()


def test_a_run_cannot_take_the_place_of_a_row_that_has_begun(
    capture: Path, tmp_path: Path, reports: list[Path]
) -> None:
    run = trained_run(capture, tmp_path / "run")
    assert compare(capture, tmp_path / "out", ["gha"], run, seeds=(4,))
    (tmp_path / "out" / "ours-seed4" / "avatar" / "avatar.json").unlink()
    (tmp_path / "out" / "ours-seed4" / "avatar").rmdir()
    with pytest.raises(DynhairError, match="has begun"):
        compare(capture, tmp_path / "out", ["gha"], run, seeds=(4,))


@pytest.fixture(scope="module")
def other(capture: Path) -> Path:
    """Another person's capture."""
    other = capture.parent / "other"
    shutil.copytree(capture, other)
    return other


def test_other_people_drive_all_rows_and_may_come_later(
    capture: Path, other: Path, tmp_path: Path, reports: list[Path]
) -> None:
    out = tmp_path / "out"
    assert compare(capture, out, ["gha"])
    (out / "gha-seed0" / "begun").unlink()
    assert compare(capture, out, ["ours"], drivers=[other])
    assert Comparison.read(out).drivers == {"other": other}
    assert (out / "ours-seed0" / "driven_by" / "other" / "metrics.json").exists()
    assert states(out) == dict.fromkeys(("hair-seed0", "gha-seed0", "ours-seed0"), "done")  # gha with what it has
    assert compare(capture, out, ["gha", "ours"])  # drivers are kept
    assert (out / "gha-seed0" / "driven_by" / "other" / "metrics.json").exists()


def test_a_row_that_nobody_could_drive_has_failed(
    capture: Path, other: Path, tmp_path: Path, reports: list[Path]
) -> None:
    out = tmp_path / "out"
    order(out, "gha-seed0", "undriven")
    assert not compare(capture, out, ["gha"], drivers=[other])
    assert states(out) == {"gha-seed0": "failed"}


def test_a_driver_is_another_capture_with_a_name_of_its_own(capture: Path, other: Path, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="cannot drive what it is the truth of"):
        compare(capture, tmp_path / "out", ["gha"], drivers=[other, capture])
    namesake = tmp_path / "other"
    shutil.copytree(other, namesake)
    with pytest.raises(DynhairError, match="two drivers are named 'other'"):
        compare(capture, tmp_path / "out", ["gha"], drivers=[other, namesake])
    assert not (tmp_path / "out").exists()


def test_another_driver_of_the_same_name_is_refused(
    capture: Path, other: Path, tmp_path: Path, reports: list[Path]
) -> None:
    compare(capture, tmp_path / "out", ["gha"], drivers=[other])
    namesake = tmp_path / "other"
    shutil.copytree(other, namesake)
    with pytest.raises(DynhairError, match="driver other"):
        compare(capture, tmp_path / "out", ["gha"], drivers=[namesake])


def test_what_is_no_capture_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(DynhairError):
        ablate(tmp_path / "none", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_folder_serves_one_command_at_a_time(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with locked(out, quiet()), pytest.raises(DynhairError, match="another process"), locked(out, quiet(), 0.0):
        pass
    with locked(out, quiet()) as lock:
        child = subprocess.Popen([sys.executable, "-S", "-c", "input()"], stdin=subprocess.PIPE, pass_fds=[lock])
    with pytest.raises(DynhairError, match="another process"), locked(out, quiet(), 0.0):
        pass  # what started the child has let go; the child has not
    child.communicate(b"\n")
    with locked(out, quiet(), 5.0):
        pass
