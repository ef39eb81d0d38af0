"""The command line: help, errors, light start-up."""

from __future__ import annotations

import subprocess
import sys
from typing import get_args

import pytest

from dynhair.cli import VERBS, StageName
from dynhair.cli_avatar import FormatName, animate

HEAVY = ("torch", "warp", "numpy", "PIL", "rich.progress", "lightning_fabric")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "dynhair", *arguments], capture_output=True, text=True, timeout=60, check=False
    )


def test_help_names_every_verb_and_loads_nothing_heavy() -> None:
    code = "import sys; sys.argv = ['dynhair', '--help']\n"
    code += "try:\n    import dynhair.__main__\nexcept SystemExit: pass\n"
    code += f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stderr.strip() == "[]"
    for verb in VERBS:
        assert verb in done.stdout


@pytest.mark.parametrize("verb", VERBS)
def test_each_verb_has_help(verb: str) -> None:
    done = run(verb, "--help")
    assert done.returncode == 0
    assert "usage: dynhair" in done.stdout


def test_a_missing_capture_is_an_error_not_a_traceback() -> None:
    done = run("train", "no/such/capture", "--out", "no/such/run")
    assert done.returncode == 2
    assert "no/such/capture" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_command_line_knows_every_stage() -> None:
    from dynhair.training import trainer

    assert get_args(StageName) == get_args(trainer.StageName)


def test_the_command_line_knows_every_format_and_every_motion() -> None:
    from dynhair.animation import MOTIONS
    from dynhair.export.run import Format

    assert get_args(FormatName) == get_args(Format)
    assert all(name in (animate.__doc__ or "") for name in MOTIONS)
