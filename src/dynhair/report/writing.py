"""A report of comparisons: a page, tables in three formats, videos, and the study of users."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from dynhair.errors import DynhairError
from dynhair.report.clips import data_url, write_side_by_side
from dynhair.report.columns import LAYOUTS, TABLE_1, TABLE_DRIVEN, Layout
from dynhair.report.comparison import Comparison, TableName
from dynhair.report.formats import latex_preamble, to_csv, to_latex, to_markdown
from dynhair.report.media import Footage, find_footage, shown_rows, write_sheet
from dynhair.report.page import DrivenPart, Film, ScenePart, TablePart, page_values
from dynhair.report.plots import Curve, Series, plot_segment
from dynhair.report.scores import Scene
from dynhair.report.study import Pair, write_study
from dynhair.report.tables import Table, fill
from dynhair.report.templates import render
from dynhair.storage import atomic_file

PAGE = "index.html"
BUDGET = 20_000_000
"""Bytes of videos that a page holds itself; where they are more, it links to them."""


def write_report(folders: Sequence[Path], out: Path, console: Console | None = None) -> Path:
    """Write ``index.html``, ``tables/``, ``pictures/``, ``videos/`` and ``user_study.html`` with its key.

    Rows that failed are shown as failed; a video or series that cannot be read is left out, and said so.

    Args:
        folders: comparisons as `dynhair compare` and `dynhair ablate` write them; one a capture. Those of one kind are
            averaged over captures as well.
        out: folder of the report.
        console: where progress goes; standard output when left out.

    Returns:
        The page.

    Raises:
        DynhairError: there is no comparison, or a folder holds none.
    """
    console = console or Console()
    if not folders:
        raise DynhairError("there are no comparisons", expected="folders of `dynhair compare` or `dynhair ablate`")
    comparisons = [Comparison.open(folder) for folder in folders]
    names = _scene_names(comparisons)
    parts: list[TablePart] = []
    pairs: list[Pair] = []
    problems: list[str] = []
    for kind in LAYOUTS:
        members = [(c, name) for c, name in zip(comparisons, names, strict=True) if c.table == kind]
        if members:
            scenes = []
            for comparison, name in members:
                with console.status(f"reporting {kind} on {name}"):
                    part, found = _scene_part(comparison, name, out, problems)
                scenes.append(part)
                pairs += found if kind == "baselines" else []
            parts.append(_table_part(kind, scenes, out))
    with console.status("writing the study of users"):
        study = _study(pairs, out, problems)
    _embed(parts, out)
    page = out / PAGE
    values = page_values(parts, problems, None if study is None else study.name)
    with atomic_file(page) as temporary:
        temporary.write_text(render("index.html.jinja", **values), encoding="utf-8")
    for problem in problems:
        console.print(f"left out: {problem}", highlight=False, markup=False, soft_wrap=True)
    for path in (page, *([] if study is None else [study])):
        console.print(f"wrote {path}", highlight=False, markup=False, soft_wrap=True)
    return page


def _scene_names(comparisons: Sequence[Comparison]) -> list[str]:
    """Names of captures, with the comparison's folder where several of one kind are on one capture."""
    repeats = Counter((comparison.table, comparison.capture) for comparison in comparisons)
    return [
        c.capture if repeats[c.table, c.capture] == 1 else f"{c.capture} ({c.path.resolve().name})" for c in comparisons
    ]


def _table_part(kind: TableName, scenes: list[ScenePart], out: Path) -> TablePart:
    average = None
    if len(scenes) > 1:
        mean = Scene.average([part.scene for part in scenes])
        average = ScenePart(mean, _write_tables(mean, out, LAYOUTS[kind]))
    return TablePart(kind, average, scenes)


def _scene_part(comparison: Comparison, name: str, out: Path, problems: list[str]) -> tuple[ScenePart, list[Pair]]:
    scene = Scene.of(comparison, name)
    part = ScenePart(scene, _write_tables(scene, out, LAYOUTS[scene.table]), comparison)
    apart = comparison.held_out()
    if apart is not None and TABLE_1 in LAYOUTS[scene.table]:
        part.held_out = _write_tables(Scene.of(apart, f"{name}, views held out"), out, (TABLE_1,))
    stem = _stem(f"{comparison.table}_{name}")
    part.plots = _plots(comparison, stem, problems)
    pairs = []
    for footage in find_footage(comparison, problems):
        film = _film(footage, f"{stem}_{_stem(footage.name)}", out, problems)
        if film is not None:
            part.films.append(film)
            pairs += footage.pairs(name)
    part.driven = [
        _driven_part(driven, f"{name}, driven by {driver}", driver, out, problems)
        for driver in comparison.drivers
        if (driven := comparison.driven_by(driver)) is not None
    ]
    return part, pairs


def _driven_part(driven: Comparison, name: str, driver: str, out: Path, problems: list[str]) -> DrivenPart:
    stem = _stem(f"{driven.table}_{name}")
    films = [
        _film(footage, f"{stem}_{_stem(footage.name)}", out, problems)
        for footage in find_footage(driven, problems, driven=True)
    ]
    tables = _write_tables(Scene.of(driven, name), out, (TABLE_DRIVEN,))
    return DrivenPart(driver, tables, [film for film in films if film is not None])


def _write_tables(scene: Scene, out: Path, layouts: Sequence[Layout]) -> list[Table]:
    tables = [table for layout in layouts if (table := fill(layout, scene)) is not None]
    for table in tables:
        stem = out / "tables" / _stem(f"{scene.table}_{table.layout.name}_{scene.name}")
        texts = {"md": to_markdown(table), "csv": to_csv(table), "tex": latex_preamble() + to_latex(table)}
        for suffix, text in texts.items():
            with atomic_file(stem.with_name(f"{stem.name}.{suffix}")) as temporary:
                temporary.write_text(text, encoding="utf-8", newline="\n")
    return tables


def _plots(comparison: Comparison, stem: str, problems: list[str]) -> dict[str, str]:
    """Plots by segment."""
    rows, series = shown_rows(comparison), {}
    for row in rows:
        try:
            series[row.label] = row.series()
        except DynhairError as error:
            problems.append(str(error))
    segments = dict.fromkeys(segment for row in rows for segment in row.test_segments)
    plots = {}
    for segment in segments:
        curves = [
            Curve(
                row.label,
                _of_segment(series[row.label], segment),
                row.figure("phase_lag_ms", segment),
            )
            for row in rows
            if row.label in series
        ]
        plot = plot_segment(curves, _stem(f"{stem}_{segment}"))
        if plot:
            plots[segment] = plot
    return plots


def _of_segment(series: Series, segment: str) -> Series:
    prefix = f"{segment}/"
    return {key.removeprefix(prefix): values for key, values in series.items() if key.startswith(prefix)}


def _film(footage: Footage, stem: str, out: Path, problems: list[str]) -> Film | None:
    sheet, video = out / "pictures" / f"{stem}.webp", out / "videos" / f"{stem}.mp4"
    try:
        write_sheet(footage, sheet)
        write_side_by_side(footage.clips, footage.labels, video)
    except DynhairError as error:
        problems.append(str(error))
        return None
    return Film(footage.name, footage.labels, data_url(sheet, "image/webp"), f"videos/{video.name}")


def _study(pairs: Sequence[Pair], out: Path, problems: list[str]) -> Path | None:
    try:
        return write_study(pairs, out, BUDGET)
    except DynhairError as error:
        problems.append(str(error))
        return None


def _embed(parts: Sequence[TablePart], out: Path) -> None:
    """Put all videos into the page if together they are small enough."""
    films = [film for part in parts for scene in part.scenes for film in scene.all_films]
    # base64 makes four bytes of three
    if sum((out / film.video).stat().st_size for film in films) * 4 / 3 <= BUDGET:
        for film in films:
            film.video = data_url(out / film.video, "video/mp4")


def _stem(name: str) -> str:
    """A name that is safe in files and ids."""
    return re.sub(r"[^\w-]+", "-", name).strip("-")
