"""Presets and configuration files."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import get_args

import pytest

from dynhair.comparison.options import PresetName
from dynhair.config import Config, read_config, write_config
from dynhair.errors import DynhairError
from dynhair.presets import PRESETS, chosen_config, preset


@pytest.mark.parametrize("name", PRESETS)
def test_presets_survive_a_file(tmp_path: Path, name: str) -> None:
    write_config(preset(name), tmp_path / "c.yaml")
    assert read_config(tmp_path / "c.yaml") == preset(name)


def test_what_a_file_leaves_out_keeps_its_default(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("hair: {strands: 7, deformer: {history: 9}}\ntraining: {weights: {rgb: 1}}\n")
    config = read_config(path)
    assert config.hair.strands == 7
    assert config.hair.deformer == dataclasses.replace(Config().hair.deformer, history=9)
    assert config.training.weights.rgb == 1.0
    assert config.head == Config().head


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("hair: {strand: 7}", "hair.strand'"),
        ("hair: {strands: many}", "hair.strands"),
        ("hair: {strands: 1.5}", "hair.strands"),
        ("hair: {strands: true}", "hair.strands"),
        ("hair: 3", "hair"),
        ("training: {precision: double}", "training.precision"),
        ("training: {perceptual_every: 0}", "training.perceptual_every"),
        ("training: {cameras: -1}", "training.cameras"),
        ("- 1", "the file"),
        ("{", "YAML"),
        ("hair: !!python/object/apply:os.getcwd []", "YAML"),
    ],
)
def test_a_wrong_setting_is_named(tmp_path: Path, text: str, found: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(text)
    with pytest.raises(DynhairError, match=found) as caught:
        read_config(path)
    assert str(path) in str(caught.value)


def test_missing_file_and_unknown_preset(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="missing"):
        read_config(tmp_path / "c.yaml")
    with pytest.raises(DynhairError, match="tiny"):
        preset("huge")


def test_given_iterations_and_seed_win() -> None:
    config = chosen_config("tiny", None, 5, 3)
    assert (config.training.iterations, config.training.seed) == (5, 3)
    assert config.hair == preset("tiny").hair
    assert chosen_config("tiny", None, None, None) == preset("tiny")


def test_the_command_line_names_every_preset() -> None:
    assert set(get_args(PresetName)) == set(PRESETS)
