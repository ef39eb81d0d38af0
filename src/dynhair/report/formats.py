"""Tables as Markdown, CSV and LaTeX."""

from __future__ import annotations

import csv
import io

from dynhair.report.columns import Column, Goal
from dynhair.report.tables import MISSING, Cell, Line, Table

_TEX = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        **{character: "\\" + character for character in "&%$#_{}"},
        "±": r"$\pm$",
        "×": r"$\times$",
        "⁻": r"$^{-}$",
        "³": r"$^{3}$",
        "²": r"$^{2}$",
        "↑": r"$\uparrow$",
        "↓": r"$\downarrow$",
        "→": r"$\rightarrow$",
        "\n": " ",
    }
)
TRUTH = "truth"


def to_markdown(table: Table) -> str:
    """Write a table of GitHub's Markdown: best values bold, second ones underlined, reasons as notes below."""
    columns, goals = table.layout.columns, table.goals
    headings = [
        f"{group.heading}: {column.heading}" if repeated(table, column) else column.heading
        for group in table.layout.groups
        for column in group.columns
    ]
    heads = [f"{heading} {goal.value}".strip() for heading, goal in zip(headings, goals, strict=True)]
    rows = [["Method", *heads], [":--", *["--:"] * len(columns)]]
    notes: dict[str, int] = {}

    def noted(text: str, reason: str) -> str:
        return f"{text}[^{notes.setdefault(reason, len(notes) + 1)}]" if reason else text

    for line in table.lines:
        label = noted(line.label, "; ".join(line.notes) or line.problem)
        cells = [noted(_markdown_cell(cell), cell.reason) for cell in line.cells]
        rows.append([label, *(cells or [_state(line)] * len(columns))])
    if table.truth:
        rows.append([f"*{TRUTH}*", *table.truth])
    lines = [f"**{_markdown_text(table.title)}**", ""]
    lines += ["| " + " | ".join(_markdown_text(cell) for cell in row) + " |" for row in rows]
    if notes:
        lines += ["", *(f"[^{number}]: {' '.join(reason.split())}" for reason, number in notes.items())]
    return "\n".join(lines) + "\n"


def to_csv(table: Table) -> str:
    """Write a table with unrounded, unscaled values: mean and spread of each figure, empty where there is none."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    keys = [column.key for column in table.layout.columns]
    writer.writerow(["method", "seeds", "state", *(name for key in keys for name in (key, f"{key}_spread"))])
    for line in table.lines:
        values = [value for cell in line.cells for value in (cell.value, cell.deviation)]
        padded = values or [None] * (2 * len(keys))
        state = line.problem or "done"
        writer.writerow([line.label, line.seeds, state, *("" if v is None else repr(v) for v in padded)])
    return file.getvalue()


def to_latex(table: Table) -> str:
    """Write a ``table*`` with the rules of booktabs: best values bold, second ones underlined."""
    groups = table.layout.groups
    spec = "l" + " ".join("c" * len(group.columns) for group in groups).replace(" ", "@{\\hspace{1.2em}}")
    heads, rules, first = [], [], 2
    for group in groups:
        last = first + len(group.columns) - 1
        heads.append(rf"\multicolumn{{{len(group.columns)}}}{{c}}{{{escape_latex(group.heading)}}}")
        rules.append(rf"\cmidrule(lr){{{first}-{last}}}")
        first = last + 1
    columns = [_tex_heading(c, g) for c, g in zip(table.layout.columns, table.goals, strict=True)]
    body = [" & ".join([escape_latex(line.label), *_tex_cells(line, len(columns))]) for line in table.lines]
    truth = [" & ".join([rf"\emph{{{TRUTH}}}", *(text or "--" for text in table.truth)])] if table.truth else []
    rows = [" & ".join(["", *heads]), " ".join(rules), " & ".join(["Method", *columns])]
    out = [
        r"\begin{table*}[t]",
        r"\centering",
        rf"\caption{{{escape_latex(table.title)}.}}",
        r"\setlength{\tabcolsep}{4pt}",
        r"\resizebox{\textwidth}{!}{%",
        rf"\begin{{tabular}}{{{spec}}}",
        r"\toprule",
        rows[0] + r" \\",
        rows[1],
        rows[2] + r" \\",
        r"\midrule",
        *(row + r" \\" for row in body),
        *([r"\midrule", *(row + r" \\" for row in truth)] if truth else []),
        r"\bottomrule",
        r"\end{tabular}}",
        r"\end{table*}",
    ]
    return "\n".join(out) + "\n"


def latex_preamble() -> str:
    """Name the packages that the tables need, as a comment."""
    return "% needs \\usepackage{booktabs} and \\usepackage{graphicx}\n"


def escape_latex(text: str) -> str:
    """Write text so that LaTeX sets it as it is."""
    return text.translate(_TEX)


def repeated(table: Table, column: Column) -> bool:
    """Whether a heading stands in more than one group, so that it needs its group's name where groups are not shown."""
    return sum(other.heading == column.heading for other in table.layout.columns) > 1


def _markdown_cell(cell: Cell) -> str:
    text = f"{cell.text} ± {cell.spread}" if cell.spread else cell.text
    return {"best": f"**{text}**", "second": f"<u>{text}</u>", "": text}[cell.mark]


def _markdown_text(text: str) -> str:
    return text.replace("|", r"\|").replace("\n", " ")


def _state(line: Line) -> str:
    return "failed" if line.problem.startswith("failed") else MISSING


def _tex_heading(column: Column, goal: Goal) -> str:
    base, _, subscript = column.heading.partition("_")
    name = escape_latex(base) + (rf"$_{{\mathrm{{{escape_latex(subscript)}}}}}$" if subscript else "")
    sign = {Goal.TRUTH: r"$\rightarrow$\,truth", Goal.ZERO: r"$\rightarrow 0$"}.get(goal, escape_latex(goal.value))
    return name + sign


def _tex_cells(line: Line, count: int) -> list[str]:
    if not line.cells:
        return [rf"\multicolumn{{{count}}}{{l}}{{\emph{{{escape_latex(_state(line))}}}}}"]
    cells = []
    for cell in line.cells:
        number = cell.text.replace("-", "$-$", 1) if cell.text.startswith("-") else cell.text
        text = number + (rf"\,{{\scriptsize$\pm${cell.spread}}}" if cell.spread else "")
        cells.append({"best": rf"\textbf{{{text}}}", "second": rf"\underline{{{text}}}", "": text}[cell.mark])
    return cells
