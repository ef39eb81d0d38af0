"""Findings: what a check of a capture has to say, the same fault of many files in one."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.table import Table
from rich.text import Text

from dynhair.errors import DynhairError

Severity = Literal["error", "warning", "note"]
_ORDER = ("error", "warning", "note")
_STYLES = {"error": "bold red", "warning": "yellow", "note": "cyan"}


@dataclass(frozen=True)
class Finding:
    """One fault and how to mend it.

    Attributes:
        severity: ``error``: cannot be trained on; ``warning``: probably not what was meant; ``note``: good to know.
        file: the first file concerned, relative to the capture.
        found: what was found in it.
        expected: what was expected instead.
        mend: what to do about it.
        count: how many files have the same fault.
    """

    severity: Severity
    file: Path
    found: str
    expected: str = ""
    mend: str = ""
    count: int = 1

    @classmethod
    def from_error(cls, error: DynhairError, root: Path) -> Finding:
        """Turn an error that reading raised into a finding."""
        path = Path(error.path) if error.path is not None else root
        file = path.relative_to(root) if path.is_relative_to(root) else path
        return cls("error", file, error.message, error.expected or "", error.mend or "")


def grouped(findings: Iterable[Finding]) -> list[Finding]:
    """Join findings that differ in numbers alone, such as frames; the gravest come first, then in order of files."""
    groups: dict[tuple[str, str, str], Finding] = {}
    for finding in sorted(findings, key=lambda f: (_ORDER.index(f.severity), str(f.file))):
        key = (finding.severity, _without_numbers(str(finding.file)), _without_numbers(finding.found))
        first = groups.setdefault(key, replace(finding, count=0))
        groups[key] = replace(first, count=first.count + finding.count)
    return list(groups.values())


def print_findings(findings: Iterable[Finding], console: Console | None = None) -> None:
    """Print findings as one table, with their number below it."""
    findings = list(findings)
    console = console or Console()
    if findings:
        table = Table(show_lines=True, title_justify="left", header_style="bold")
        for column in ("", "file", "found", "expected", "to mend it"):
            table.add_column(column, overflow="fold", no_wrap=column == "")
        for finding in findings:
            more = f"\nand {finding.count - 1:,} more" if finding.count > 1 else ""
            texts = (str(finding.file) + more, finding.found, finding.expected, finding.mend)
            table.add_row(Text(finding.severity, _STYLES[finding.severity]), *(Text(text) for text in texts))
        console.print(table)
    totals = [
        f"{count} {severity}{'s' * (count != 1)}"
        for severity in _ORDER
        if (count := sum(f.severity == severity for f in findings))
    ]
    console.print(", ".join(totals) or "no findings", highlight=False)


def _without_numbers(text: str) -> str:
    return re.sub(r"\d+(\.\d+)?", "#", text)
