"""The page and its files: what a reader sees, whatever state the comparisons are in."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from made_comparisons import made_comparison, made_row
from rich.console import Console

from dynhair.errors import DynhairError
from dynhair.report import write_report, writing

VOID = {"meta", "link", "img", "br", "input", "hr", "source"}


class Outline(HTMLParser):
    """Checks that elements nest, and collects ids, links and text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        values = dict(attrs)
        self.ids += [values["id"] or ""] if "id" in values else []
        self.links += [values[name] or "" for name in ("src", "href") if name in values]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open and "script" not in self.open:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def outline(page: Path) -> Outline:
    parser = Outline()
    parser.feed(page.read_text())
    parser.close()
    assert not parser.open
    assert len(parser.ids) == len(set(parser.ids))
    return parser


def report(folders: list[Path], out: Path) -> Outline:
    return outline(write_report(folders, out, Console(quiet=True)))


def two_methods(
    folder: Path, psnr: tuple[float, float] = (21.0, 22.0), *, videos: bool = False, table: str = "baselines"
):
    other = "gha" if table == "baselines" else "no-film"
    rows = [
        made_row(folder, method, {"psnr": value, "lpips": 0.5 - 0.1 * index, "phase_lag_ms": 33.0}, videos=videos)
        for index, (method, value) in enumerate(zip((other, "ours"), reversed(psnr), strict=True))
    ]
    return made_comparison(folder, rows, table=table)


def test_a_page_says_first_where_others_are_better(tmp_path: Path) -> None:
    text = report([two_methods(tmp_path / "c")], tmp_path / "out").text
    behind, ahead, tables = (
        text.index(words)
        for words in ("Where a baseline is better than ours", "Where ours is the best", "Appearance and motion")
    )
    assert behind < text.index("GHA 22.00 dB is better by 1.00 dB") < ahead
    assert ahead < text.index("LPIPS of the whole image : Ours 0.4000 (lower is better)") < tables


def test_a_page_that_has_nothing_to_admit_says_so_in_the_same_place(tmp_path: Path) -> None:
    text = report([two_methods(tmp_path / "c", (23.0, 22.0))], tmp_path / "out").text
    first = text.index("Where a baseline is better than ours")
    assert first < text.index("In none of the figures that could be compared") < text.index("Where ours is the best")


def test_a_page_needs_nothing_but_itself(tmp_path: Path) -> None:
    page = report([two_methods(tmp_path / "c", videos=True)], tmp_path / "out")
    outside = [link for link in page.links if not link.startswith(("data:", "#"))]
    assert outside == ["user_study.html"]
    for name in ("index.html", "user_study.html"):
        assert "://" not in (tmp_path / "out" / name).read_text()


def test_large_videos_are_linked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writing, "BUDGET", 100)
    page = report([two_methods(tmp_path / "c", videos=True)], tmp_path / "out")
    assert "videos/baselines_long_nod.mp4" in page.links
    assert (tmp_path / "out" / "videos" / "baselines_long_nod.mp4").stat().st_size > 100


@pytest.mark.parametrize("size", [None, [64, 0], "64x48"])
def test_videos_of_unknown_size_are_left_out_and_named(size: object, tmp_path: Path) -> None:
    folder = two_methods(tmp_path / "c", videos=True)
    file = folder / "gha-seed0" / "evaluation" / "metrics.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"image_size": size}))
    text = report([folder], tmp_path / "out").text
    assert f"'image_size' is {size!r}" in text
    assert str(file) in text
    assert len(list((tmp_path / "out" / "videos").iterdir())) == 1  # of ours alone


def test_plots_take_the_ink_of_the_page_and_tell_the_lag(tmp_path: Path) -> None:
    page = report([two_methods(tmp_path / "c")], tmp_path / "out")
    text = (tmp_path / "out" / "index.html").read_text()
    assert text.count("<svg") == 1
    assert "currentColor" in text
    assert "#010203" not in text
    for words in ("speed of the tips, m/s", "tIoU of the hair", "error at the tips, mm", "Ours (lags by 33 ms)"):
        assert words in page.text


def test_every_table_is_there_in_three_formats(tmp_path: Path) -> None:
    report([two_methods(tmp_path / "c")], tmp_path / "out")
    files = {path.name for path in (tmp_path / "out" / "tables").iterdir()}
    names = ("table1", "table2", "motion")
    assert files == {f"baselines_{name}_long.{suffix}" for name in names for suffix in ("md", "csv", "tex")}


def test_rows_that_failed_or_wait_are_shown_as_such(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    rows = [
        made_row(folder, "ours", {"psnr": 20.0}),
        made_row(folder, "gha", {}, state="failed", error="loss <b>nan</b>"),
        made_row(folder, "ga", {}, state="pending"),
    ]
    page = report([made_comparison(folder, rows)], tmp_path / "out")
    assert "failed: loss <b>nan</b>" in page.text
    assert "not run yet" in page.text


def test_missing_figures_have_their_reason_as_tooltip_and_note(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    rows = [
        made_row(folder, "ours", {"hair_iou": 0.9}),
        made_row(folder, "gha", {"hair_iou": None}, reasons={"hair_iou": 'no "coverage"'}),
    ]
    page = report([made_comparison(folder, rows)], tmp_path / "out")
    text = (tmp_path / "out" / "index.html").read_text()
    assert 'title="no &#34;coverage&#34;"' in text
    assert "<li>no &#34;coverage&#34;</li>" in text
    assert "n/a" in page.text


def test_no_figure_and_no_row_done_still_makes_a_page(tmp_path: Path) -> None:
    rows = [made_row(tmp_path / "c", m, {}, state="failed", error="killed") for m in ("ours", "gha")]
    assert "failed: killed" in report([made_comparison(tmp_path / "c", rows)], tmp_path / "out").text


def test_what_cannot_be_read_is_left_out_and_said_so(tmp_path: Path) -> None:
    folder = two_methods(tmp_path / "c", videos=True)
    evaluation = folder / "gha-seed0" / "evaluation"
    (evaluation / "series.npz").write_bytes(b"broken")
    (evaluation / "test_nod.mp4").write_bytes(b"broken")
    console = Console(record=True, width=200, quiet=False, file=(tmp_path / "log").open("w"))
    page = outline(write_report([folder], tmp_path / "out", console))
    console.file.close()
    for name in ("series.npz", "test_nod.mp4"):
        assert name in page.text
        assert name in (tmp_path / "log").read_text()
    assert not (tmp_path / "out" / "user_study.html").exists()


def test_other_peoples_motions_have_a_table_and_a_video(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    rows = [
        made_row(folder, "ours", {"psnr": 21.0, "ver": 2.5}, driven_by="curly"),
        made_row(folder, "gha", {"psnr": 20.0, "ver": 1.5}, driven_by="curly"),
        made_row(folder, "ga", {"psnr": 19.0, "ver": 0.5}),
    ]
    page = report([made_comparison(folder, rows, drivers=["curly", "nobody-drove"])], tmp_path / "out")
    shown = page.text[page.text.index("Baselines: long, driven by curly") :]
    assert "Motion of the hair Motion Physics Strands" in shown
    assert "PSNR" not in shown
    assert "not run yet" in shown  # of ga
    assert "driver | Ours | GHA" in shown
    assert "nobody-drove" not in page.text
    assert "driver" not in page.text[: -len(shown)]
    table = (tmp_path / "out" / "tables" / "baselines_driven_long-driven-by-curly.csv").read_text()
    assert "2.5" in table
    markdown = (tmp_path / "out" / "tables" / "baselines_driven_long-driven-by-curly.md").read_text()
    assert "1.50" in markdown
    assert "**1.50" not in markdown  # the lowest is not the best where nothing is true
    assert any(link.startswith("data:video/mp4") for link in page.links)


def test_a_driver_is_the_name_of_a_folder(tmp_path: Path) -> None:
    folder = made_comparison(tmp_path / "c", [made_row(tmp_path / "c", "ours", {})], drivers=["../elsewhere"])
    with pytest.raises(DynhairError, match=r"a driver is named '\.\./elsewhere'"):
        report([folder], tmp_path / "out")


def test_captures_stand_for_themselves_and_averaged(tmp_path: Path) -> None:
    folders = []
    for name, psnr in (("long", (20.0, 21.0)), ("bob", (24.0, 23.0))):
        folder = two_methods(tmp_path / name, psnr)
        text = (folder / "comparison.json").read_text()
        (folder / "comparison.json").write_text(text.replace("captures/long", f"captures/{name}"))
        folders.append(folder)
    text = report(folders, tmp_path / "out").text
    assert "Baselines: figures, mean of 2 captures" in text
    assert "Figures of long" in text
    assert "Figures of bob" in text
    assert text.index("Level with the best of the others: PSNR of the whole image") < text.index("Figures of long")
    assert text.index("GHA 21.00 dB is better by 1.00 dB") > text.index("Figures of long")


def test_two_comparisons_of_one_capture_are_told_apart(tmp_path: Path) -> None:
    text = report([two_methods(tmp_path / name) for name in ("first", "second")], tmp_path / "out").text
    assert "Figures of long (first)" in text
    assert "Figures of long (second)" in text
    assert len(list((tmp_path / "out" / "tables").glob("baselines_table1_*.md"))) == 3


def test_baselines_and_ablations_share_a_page(tmp_path: Path) -> None:
    folders = [two_methods(tmp_path / "a", table="ablations"), two_methods(tmp_path / "b")]
    text = report(folders, tmp_path / "out").text
    assert text.index("Where a baseline is better") < text.index("Where another variant is better")


def test_differences_of_protocol_are_named_by_method(tmp_path: Path) -> None:
    rows = [
        made_row(tmp_path / "c", "ours", {"psnr": 20.0}, protocol={"networks": "AlexNet"}),
        made_row(tmp_path / "c", "gha", {"psnr": 20.0}, protocol={"networks": "none"}),
    ]
    text = report([made_comparison(tmp_path / "c", rows)], tmp_path / "out").text
    assert re.search(r"networks Ours: AlexNet GHA: none", text)
    assert "dB, -10 log10(MSE)" in text


def test_views_held_out_have_a_table_of_their_own(tmp_path: Path) -> None:
    rows = [
        made_row(tmp_path / "c", method, {"psnr": psnr}, held_out={"psnr": psnr - 5.0})
        for method, psnr in (("ours", 20.0), ("gha", 21.0))
    ]
    text = report([made_comparison(tmp_path / "c", rows)], tmp_path / "out").text
    assert "16.00" in text[text.index("Over the views that training held out: long") :]
    assert "GHA 21.00 dB is better by 1.00 dB" in text
    table = (tmp_path / "out" / "tables" / "baselines_table1_long-views-held-out.csv").read_text()
    assert "GHA,1,done,16.0," in table


def test_no_comparison_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="there are no comparisons"):
        write_report([], tmp_path)
    with pytest.raises(DynhairError, match="the file is missing"):
        write_report([tmp_path], tmp_path / "out", Console(quiet=True))
    assert not (tmp_path / "out").exists()
