"""Tables: what is marked as best, and what Markdown, CSV and LaTeX say of it."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_comparisons import made_comparison, made_row

from dynhair.report.columns import LAYOUTS, TABLE_1, TABLE_2, TABLE_4, Goal, figures_of
from dynhair.report.comparison import Comparison
from dynhair.report.formats import escape_latex, to_csv, to_latex, to_markdown
from dynhair.report.scores import Scene
from dynhair.report.tables import Table, fill, marks

TWO_DECIMALS = st.integers(-999, 999).map(lambda n: f"{n / 100:.2f}")
SPECIAL = "a_b & 50% #1 {x} $y$ ~z^2 \\n"


def table(folder: Path, layout: int = 0, *, kind: str = "baselines") -> Table:
    """Ours with two seeds, a method with a strange name and a missing figure, and one that failed."""
    figures = {"psnr": 21.0, "lpips": 0.21, "hair_tiou": 0.95, "hair_tiou_truth": 0.9, "hair_tlpips_excess": -0.01}
    rows = [
        made_row(folder, "ours", figures),
        made_row(folder, "ours", figures | {"psnr": 22.0}, seed=1),
        made_row(folder, "gha", figures | {"hair_tiou": None}, label=SPECIAL, reasons={"hair_tiou": "no | hair"}),
        made_row(folder, "ga", {}, state="failed", error="out of memory\nmend: fewer"),
    ]
    comparison = Comparison.open(made_comparison(folder, rows, table=kind))
    filled = fill(LAYOUTS[comparison.table][layout], Scene.of(comparison, "long_hair"))
    assert filled is not None
    return filled


@pytest.mark.parametrize(
    ("goal", "shown", "truth", "best", "second"),
    [
        (Goal.HIGH, ["1.0", "3.0", "2.0"], "", {1}, {2}),
        (Goal.LOW, ["1.0", "3.0", "2.0"], "", {0}, {2}),
        (Goal.ZERO, ["-0.3", "0.1", "-0.2"], "", {1}, {2}),
        (Goal.TRUTH, ["0.95", "0.86", "0.93"], "0.90", {2}, {1}),
        (Goal.TRUTH, ["0.95", "0.86"], "", set(), set()),
        (Goal.NONE, ["1.0", "2.0"], "", set(), set()),
        (Goal.HIGH, ["2.0", "2.0", "1.0", "1.0", "0.0"], "", {0, 1}, {2, 3}),
        (Goal.ZERO, ["-0.1", "0.1", "n/a"], "", {0, 1}, set()),
        (Goal.TRUTH, ["0.88", "0.92", "0.80"], "0.90", {0, 1}, {2}),
        (Goal.LOW, ["n/a", "5.0", "4.0"], "", {2}, {1}),
        (Goal.HIGH, ["n/a", "5.0"], "", set(), set()),
        (Goal.HIGH, ["n/a", "n/a"], "", set(), set()),
    ],
)
def test_best_and_second(goal: Goal, shown: list[str], truth: str, best: set[int], second: set[int]) -> None:
    found = marks(goal, shown, truth)
    assert {i for i, mark in enumerate(found) if mark == "best"} == best
    assert {i for i, mark in enumerate(found) if mark == "second"} == second


@given(
    st.sampled_from([Goal.HIGH, Goal.LOW, Goal.ZERO, Goal.TRUTH]),
    st.lists(TWO_DECIMALS, min_size=2, max_size=6),
    TWO_DECIMALS,
)
def test_nothing_is_better_than_the_best(goal: Goal, shown: list[str], truth: str) -> None:
    cents = [round(100 * float(text)) for text in shown]
    aim = {Goal.TRUTH: round(100 * float(truth)), Goal.ZERO: 0, Goal.HIGH: 10**6, Goal.LOW: -(10**6)}[goal]
    distances = [abs(value - aim) for value in cents]
    found = marks(goal, shown, truth)
    order = sorted(set(distances))
    for distance, mark in zip(distances, found, strict=True):
        assert mark == ("best" if distance == order[0] else "second" if distance == order[1] else "")


def test_a_table_shows_figures_as_the_paper_does(tmp_path: Path) -> None:
    filled = table(tmp_path)
    ours, gha, ga = filled.lines
    keys = [column.key for column in filled.layout.columns]
    psnr, tiou, flicker = (keys.index(key) for key in ("psnr", "hair_tiou", "hair_tlpips_excess"))
    assert (ours.cells[psnr].text, ours.cells[psnr].spread, ours.cells[psnr].mark) == ("21.50", "0.71", "best")
    assert gha.cells[psnr].mark == "second"
    assert (gha.cells[tiou].text, gha.cells[tiou].reason) == ("n/a", "no | hair")
    assert ours.cells[flicker].text == "-0.0100"
    assert ga.cells == ()
    assert ga.problem == "failed: out of memory\nmend: fewer"
    assert filled.truth[tiou] == "0.900"
    assert filled.goals[tiou] is Goal.TRUTH
    assert filled.goals[keys.index("hair_velocity")] is Goal.NONE


@pytest.mark.parametrize(("truth", "goal", "best"), [(20.0, Goal.TRUTH, "ours"), (None, Goal.LOW, "rigid")])
def test_still_hair_explodes_least_but_the_truth_moves(
    truth: float | None, goal: Goal, best: str, tmp_path: Path
) -> None:
    rows = [
        made_row(tmp_path, method, {"ver": ver, "ver_truth": truth}) for method, ver in (("ours", 15.0), ("rigid", 0.0))
    ]
    filled = fill(TABLE_2, Scene.of(Comparison.open(made_comparison(tmp_path, rows)), "long"))
    assert filled is not None
    ver = [column.key for column in filled.layout.columns].index("ver")
    assert filled.goals[ver] is goal
    marked = [line.cells[ver].mark for line in filled.lines]
    assert marked == (["best", "second"] if best == "ours" else ["second", "best"])


def test_the_papers_two_tables_of_ablations_share_out_the_rows(tmp_path: Path) -> None:
    methods = ("ours", "no-film", "one-view", "something-new")
    rows = [made_row(tmp_path, method, {"psnr": 20.0}) for method in methods]
    scene = Scene.of(Comparison.open(made_comparison(tmp_path, rows, table="ablations")), "long")
    second, fourth = fill(TABLE_2, scene), fill(TABLE_4, scene)
    assert second is not None
    assert fourth is not None
    assert [line.label for line in second.lines] == ["Ours", "no-film", "something-new"]
    assert [line.label for line in fourth.lines] == ["Ours", "one-view"]


def test_a_table_of_ours_alone_is_left_out(tmp_path: Path) -> None:
    rows = [made_row(tmp_path, method, {}) for method in ("ours", "no-film")]
    assert fill(TABLE_4, Scene.of(Comparison.open(made_comparison(tmp_path, rows, table="ablations")), "long")) is None


def test_every_figure_has_one_goal_and_scale_in_all_tables() -> None:
    for kind, layouts in LAYOUTS.items():
        columns = [column for layout in layouts for column in layout.columns]
        known = {column.key: column for column in figures_of(kind)}
        assert set(known) == {column.key for column in columns}
        for column in columns:
            twin = known[column.key]
            assert (column.goal, column.scale, column.decimals) == (twin.goal, twin.scale, twin.decimals)


def test_columns_of_unknown_size_show_three_digits() -> None:
    drift = next(column for column in TABLE_2.columns if column.key == "amd")
    assert [drift.shown(v, drift.places([v])) for v in (7787.4, 7.8912, 0.00022, 0.0)] == [
        "7787",
        "7.89",
        "0.000220",
        "0",
    ]


def test_csv_holds_the_unrounded_values(tmp_path: Path) -> None:
    filled = table(tmp_path)
    rows = list(csv.DictReader(io.StringIO(to_csv(filled))))
    assert [row["method"] for row in rows] == ["Ours", SPECIAL, "GA"]
    for row, line in zip(rows, filled.lines, strict=True):
        for column, cell in zip(filled.layout.columns, line.cells, strict=False):
            assert (float(row[column.key]) if row[column.key] else None) == cell.value
            spread = row[f"{column.key}_spread"]
            assert (float(spread) if spread else None) == cell.deviation
    assert rows[0]["psnr"] == "21.5"
    assert rows[2]["state"] == "failed: out of memory\nmend: fewer"
    assert rows[2]["psnr"] == ""


def test_markdown_is_a_table_with_marks_and_notes(tmp_path: Path) -> None:
    text = to_markdown(table(tmp_path))
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    assert len({len(row) for row in cells}) == 1
    assert len(cells[0]) == 1 + len(TABLE_1.columns)
    assert cells[0][1] == "Full image: PSNR ↑"
    assert cells[2][:2] == ["Ours", "**21.50 ± 0.71**"]
    assert cells[3][1] == "<u>21.00</u>"
    assert cells[4] == ["GA[^3]", *["failed"] * len(TABLE_1.columns)]
    assert "[^3]: failed: out of memory mend: fewer" in text
    assert cells[-1][0] == "*truth*"


def test_latex_is_balanced_and_escaped(tmp_path: Path) -> None:
    filled = table(tmp_path)
    text = to_latex(filled)
    assert_latex_is_balanced(text)
    rows = [row for row in text.splitlines() if row.endswith(r"\\")]
    widths = [sum(span_of(cell) for cell in re.split(r"(?<!\\)&", row)) for row in rows]
    assert widths == [1 + len(filled.layout.columns)] * len(rows)
    assert r"\textbf{21.50\,{\scriptsize$\pm$0.71}}" in text
    assert r"\underline{21.00}" in text
    assert r"a\_b \& 50\% \#1 \{x\} \$y\$ \textasciitilde{}z\textasciicircum{}2 \textbackslash{}n" in text
    assert r"\caption{Appearance and motion, as in the paper's Table 1: long\_hair.}" in text
    assert "IoU$_{\\mathrm{hair}}$$\\uparrow$" in text


@given(st.text(alphabet="ab\\{}$&%#_~^ ±↑", max_size=20))
def test_escaped_text_is_set_as_it_is(text: str) -> None:
    escaped = escape_latex(text)
    assert_latex_is_balanced(escaped)
    # what remains special must be that of the escapes themselves
    for macro, plain in {r"\textbackslash{}": "\\", r"\textasciitilde{}": "~", r"\textasciicircum{}": "^"}.items():
        escaped = escaped.replace(macro, chr(0xE000 + ord(plain)))
    for macro, plain in {r"$\pm$": "±", r"$\uparrow$": "↑"}.items():
        escaped = escaped.replace(macro, chr(0xE000 + ord(plain) % 256))
    escaped = re.sub(r"\\([&%$#_{}])", lambda found: chr(0xE100 + ord(found[1])), escaped)
    assert not set(escaped) & set("\\{}$&%#_~^")


def span_of(cell: str) -> int:
    found = re.match(r"\s*\\multicolumn\{(\d+)\}", cell)
    return int(found[1]) if found else 1


def assert_latex_is_balanced(text: str) -> None:
    depth, environments = 0, []
    plain = re.sub(r"\\[{}$\\]", "", text)
    for character in plain:
        depth += {"{": 1, "}": -1}.get(character, 0)
        assert depth >= 0
    assert depth == 0
    assert plain.count("$") % 2 == 0
    for kind, name in re.findall(r"\\(begin|end)\{(\w+\*?)\}", text):
        if kind == "begin":
            environments.append(name)
        else:
            assert environments.pop() == name
    assert not environments
