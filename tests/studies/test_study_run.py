"""What a study is asked for, what it finds there already, and the tables it writes."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
import pytest
from made_motions import made_motion
from rich.console import Console
from studies.hair_motion import __main__ as command
from studies.hair_motion import study
from studies.hair_motion.grooms import GROOMS, HeadMesh
from studies.hair_motion.motions import ELEVEN, LESSONS, UNSEEN, head_motion
from studies.hair_motion.pages import write_page
from studies.hair_motion.simulation import posed_head, simulated
from studies.hair_motion.study import Job, fit_all, jobs

from dynhair.errors import DynhairError
from dynhair.export.blender import VARIABLE


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--grooms", "bald"], "no groom is called `bald`"),
        (["--rows", "magic"], "no row is called `magic`"),
        (["--counts", "0"], "0 motions to learn from"),
        (["--counts", "41"], "41 motions to learn from"),
        (["--seeds", "0"], "0 seeds"),
    ],
)
def test_what_is_not_there_is_refused(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main([str(tmp_path), *arguments]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


def test_without_blender_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "no-blender"))
    still = tmp_path / "long" / "settled.npy"
    still.parent.mkdir()
    np.save(still, np.zeros((1, 3, 3)))
    with pytest.raises(DynhairError, match="which is no program"):
        simulated(tmp_path, "long", "turn")


def test_a_program_that_fails_is_quoted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(VARIABLE, sys.executable)  # a Python without bpy
    still = tmp_path / "long" / "settled.npy"
    still.parent.mkdir()
    np.save(still, np.zeros((1, 3, 3)))
    with pytest.raises(DynhairError, match="bpy"):
        simulated(tmp_path, "long", "turn")
    assert [path.name for path in (tmp_path / "long").iterdir()] == ["settled.npy"]


def test_a_motion_that_is_there_is_not_simulated_again(tmp_path: Path) -> None:
    path = tmp_path / "long" / "turn.npz"
    path.parent.mkdir()
    path.write_bytes(b"")
    assert simulated(tmp_path, "long", "turn") == path


def test_the_head_turns_on_shoulders_that_stay() -> None:
    head = HeadMesh(
        vertices=np.array([[0.0, 0.1, 0.0], [0.1, -0.2, 0.0]], np.float32),
        faces=np.zeros((0, 3), np.int64),
        scalp=np.zeros(0, np.int64),
        weight=np.array([1.0, 0.0], np.float32),
    )
    motion = head_motion("random1")
    posed = posed_head(head, motion)
    rigid = motion.rotations @ head.vertices[0].astype(np.float64) + motion.translations
    np.testing.assert_allclose(posed[:, 0], rigid, atol=1e-9)
    np.testing.assert_allclose(posed[:, 1], head.vertices[1][None].repeat(75, 0), atol=1e-7)


def test_eleven_motions_come_first() -> None:
    work = jobs(["long"], ["24 modes"], [4, 11, 2], 2)
    assert [(job.motions, job.seed) for job in work] == [(11, 0), (2, 0), (4, 0), (11, 1), (2, 1), (4, 1)]
    assert len({job.file for job in work}) == 6


def test_a_row_beside_other_hair_wants_the_lessons_of_all_but_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    wanted: list[tuple[str, str]] = []
    monkeypatch.setattr(study, "simulated", lambda folder, groom, name, disturbance: wanted.append((groom, name)))
    work = jobs(["bob"], ["strand dynamics, beside other hair"], [2], 1)
    study.simulate_all(tmp_path, work, Console(quiet=True))
    assert {name for groom, name in wanted if groom == "bob"} == {*UNSEEN, *ELEVEN[:2]}
    assert {groom for groom, _ in wanted} == set(GROOMS)
    assert {name for groom, name in wanted if groom == "long"} == set(LESSONS)
    assert not set(LESSONS) & set(UNSEEN)


def test_tables_say_what_was_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("turn", "nod", "stop", "stop-disturbed", "random5", "random5-disturbed"):
        motion = made_motion(name.removesuffix("-disturbed"))
        head = head_motion(name.removesuffix("-disturbed"))
        path = tmp_path / "simulated" / "long" / f"{name}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        hair = (motion.canonical + motion.displacements).numpy()
        np.savez(path, guides=hair, rotations=head.rotations, translations=head.translations)
    monkeypatch.setattr("studies.hair_motion.study.LEARNED", ("turn", "nod"))
    monkeypatch.setattr("studies.hair_motion.study.UNSEEN", ("stop", "random5"))
    monkeypatch.setattr("studies.hair_motion.fitting.STEPS", {"modal": 2, "paper": 2})
    work = [Job("long", "8 modes", count, 0) for count in (1, 2)]
    fit_all(tmp_path, work, Console(file=io.StringIO()))
    files = sorted((tmp_path / "results").iterdir())
    assert len(files) == 2
    written = [path.stat().st_mtime_ns for path in files]
    fit_all(tmp_path, work, Console(file=io.StringIO()))
    assert [path.stat().st_mtime_ns for path in files] == written
    monkeypatch.setattr("studies.hair_motion.pages.ELEVEN", ("turn", "nod"))
    write_page(tmp_path)
    said = (tmp_path / "tables.md").read_text(encoding="utf-8")
    assert "| 8 modes |" in said
    assert "explains 1.00 of `stop`, 1.00 of `random5`" in said
    assert "2.5 s | 5 s" in said
    assert (tmp_path / "growth.png").stat().st_size > 1000
