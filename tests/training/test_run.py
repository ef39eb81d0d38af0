"""Run folders."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from dynhair.errors import DynhairError
from dynhair.presets import preset
from dynhair.training.run import Run, avatar_folder, read_hair, trained_capture, write_hair


def test_a_run_opens_as_it_was_created(tmp_path: Path) -> None:
    created = Run.create(tmp_path / "run", tmp_path / "capture", preset("tiny"))
    opened = Run.open(tmp_path / "run")
    assert opened == created
    assert read_hair(opened.canonical_hair) is None
    strands = torch.randn(3, 4, 3)
    write_hair(strands, created.canonical_hair)
    kept = read_hair(opened.canonical_hair)
    assert kept is not None
    assert torch.equal(kept, strands)


def test_a_kill_while_a_run_is_created_leaves_nothing_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object) -> None:
        raise SystemExit

    with monkeypatch.context() as patched, pytest.raises(SystemExit):
        patched.setattr("dynhair.training.run.write_json", killed)
        Run.create(tmp_path / "run", tmp_path, preset("tiny"))
    assert not (tmp_path / "run").exists()
    Run.create(tmp_path / "run", tmp_path, preset("tiny"))
    assert Run.open(tmp_path / "run").config == preset("tiny")


def test_a_taken_folder_is_refused_and_kept(tmp_path: Path) -> None:
    (tmp_path / "precious").touch()
    with pytest.raises(DynhairError, match="something already"):
        Run.create(tmp_path, tmp_path, preset("tiny"))
    assert [p.name for p in tmp_path.iterdir()] == ["precious"]


def test_no_run_and_a_later_version_are_named(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="no run to go on with"):
        Run.open(tmp_path)
    (tmp_path / "run.json").write_text(json.dumps({"kind": "dynhair run", "version": 99}))
    with pytest.raises(DynhairError, match="version 99"):
        Run.open(tmp_path)


def test_damaged_canonical_hair_is_named(tmp_path: Path) -> None:
    run = Run.create(tmp_path / "run", tmp_path, preset("tiny"))
    (run.path / "canonical_hair.safetensors").write_bytes(b"not safetensors")
    with pytest.raises(DynhairError, match="canonical_hair"):
        read_hair(run.canonical_hair)


def test_avatars_are_found_by_run_or_folder(tmp_path: Path) -> None:
    run = Run.create(tmp_path / "run", tmp_path / "capture", preset("tiny"))
    assert avatar_folder(run.path) == run.avatar
    assert avatar_folder(run.avatar) == run.avatar
    run.avatar.mkdir()
    assert trained_capture(run.path) == trained_capture(run.avatar) == (tmp_path / "capture").resolve()
    with pytest.raises(DynhairError, match="--capture"):
        trained_capture(tmp_path / "elsewhere")
