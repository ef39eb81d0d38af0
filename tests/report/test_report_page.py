"""The page and its files: what a reader sees, whatever state the comparisons are in."""

from __future__ import annotations

from pathlib import Path

from made_comparisons import made_comparison, made_row
from rich.console import Console

from dynhair.report import write_report


def test_a_report_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "comparison"
    rows = [
        made_row(folder, "ours", {"psnr": 21.0, "lpips": 0.2}, videos=True),
        made_row(folder, "gha", {"psnr": 22.0, "lpips": 0.3}, videos=True),
    ]
    page = write_report([made_comparison(folder, rows)], tmp_path / "report", Console(quiet=True))
    assert page == tmp_path / "report" / "index.html"
    assert "GHA 22.00 dB is better by 1.00 dB" in page.read_text()
