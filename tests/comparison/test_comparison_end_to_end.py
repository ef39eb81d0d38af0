"""A whole ablation and a whole comparison: trained, measured and reported in processes of their own."""

from __future__ import annotations

import io
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from rich.console import Console

from dynhair.comparison.options import RowOptions
from dynhair.comparison.record import Comparison
from dynhair.comparison.run import run_ablation, run_comparison
from dynhair.config import Config, DeformerConfig, HairConfig, HeadConfig, StaticConfig, TrainingConfig
from dynhair.presets import PRESETS
from dynhair.storage import read_json
from synthetic import write_synthetic_capture

CONFIG = Config(
    hair=HairConfig(strands=60, points=10, deformer=DeformerConfig(hidden=8, width=16)),
    static=StaticConfig(encoder_iterations=1, style_generations=0, iterations=4),
    head=HeadConfig(gaussians=500, features=4, deformation_width=16, appearance_width=8),
    training=TrainingConfig(views=2, image_size=32, precision="float32", checkpoint_every=5, preview_every=6),
)
ROW_WITHOUT_DOWNLOADS = """
import sys
from dynhair.comparison import row
from dynhair.evaluation.appearance import Appearance
from dynhair.evaluation.perception import Perception
Appearance.published = lambda: Appearance(Perception(None, "none"), Perception(None, "none"), None, "none")
sys.exit(row.main(*sys.argv[1:]))
"""


def without_downloads(path: Path, name: str) -> Sequence[str]:
    return (sys.executable, "-c", ROW_WITHOUT_DOWNLOADS, str(path), name)


@pytest.mark.slow
def test_two_rows_are_trained_alike_and_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "tiny", CONFIG)  # pyright: ignore[reportArgumentType]
    capture = write_synthetic_capture(tmp_path / "capture", frames=4, views=2, size=32)
    out, console = tmp_path / "out", Console(file=io.StringIO(), width=200)

    def ablate() -> bool:
        return run_ablation(
            capture,
            out,
            RowOptions("tiny", iterations=6, jobs=2, memory=16.0),
            rows=["rigid"],
            console=console,
            command=without_downloads,
        )

    succeeded = ablate()
    comparison = Comparison.read(out)
    assert succeeded, [row.error for row in comparison.rows.values()]
    full, rigid = (comparison.folder(name) for name in ("full-seed0", "rigid-seed0"))
    hair = (comparison.folder("hair-seed0") / "canonical_hair.safetensors").read_bytes()
    for folder in (full, rigid):
        assert (folder / "canonical_hair.safetensors").read_bytes() == hair
        assert read_json(folder / "evaluation" / "metrics.json")["hair_iou"] >= 0
        assert "6 of 6" in (folder / "train.log").read_text()
        assert "canonical hair" not in (folder / "train.log").read_text()
    assert "dynamic: false" in (rigid / "config.yaml").read_text()
    for row in comparison.rows.values():
        assert row.seconds_trained is not None
        assert row.seconds_trained > 0
        assert sys.platform != "linux" or (row.peak_memory or 0) > 100_000_000
    assert (out / "report" / "index.html").exists()

    before = (full / "avatar" / "avatar.safetensors").stat().st_mtime_ns
    assert ablate()
    assert (full / "avatar" / "avatar.safetensors").stat().st_mtime_ns == before


@pytest.mark.slow
def test_methods_without_strands_are_trained_and_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "tiny", CONFIG)  # pyright: ignore[reportArgumentType]
    capture = write_synthetic_capture(tmp_path / "capture", frames=4, views=2, size=32)
    out, console = tmp_path / "out", Console(file=io.StringIO(), width=200)
    succeeded = run_comparison(
        capture,
        out,
        RowOptions("tiny", iterations=4, jobs=2, memory=16.0),
        methods=["gha", "ga"],
        console=console,
        command=without_downloads,
    )
    comparison = Comparison.read(out)
    assert succeeded, [row.error for row in comparison.rows.values()]
    for method in ("gha", "ga"):
        folder = comparison.folder(f"{method}-seed0")
        assert read_json(folder / "avatar" / "avatar.json")["kind"] == f"dynhair {method} baseline"
        assert read_json(folder / "evaluation" / "metrics.json")["psnr"] > 0
    assert (out / "report" / "index.html").exists()
