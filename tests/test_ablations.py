"""The named ablations change what they say and nothing else."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from dynhair.ablations import ABLATIONS, AblationName, ablated
from dynhair.config import with_deformer
from dynhair.presets import preset

CHANGES: dict[str, set[str]] = {
    "paper-deformer": {f"hair.deformer.{name}" for name in ("kind", "history", "turn", "inextensible")},
    "modal-deformer": {"hair.deformer.kind"},
    "untaught": {"hair.deformer.taught"},
    "pose": {"hair.deformer.signals"},
    "no-acceleration": {"hair.deformer.acceleration"},
    "no-gravity": {"hair.deformer.gravity"},
    "no-turn": {"hair.deformer.turn"},
    "no-elastic": {"training.weights.elastic"},
    "stretching": {"hair.deformer.inextensible"},
    "no-film": {"hair.deformer.film"},
    "mlp-encoder": {"hair.deformer.encoder"},
    "no-colour-terms": {
        "training.weights.colour_gradient",
        "training.weights.colour_spatial",
        "training.weights.colour_consistency",
    },
    "no-raised-perceptual": {"training.weights.perceptual_raised"},
    "one-view": {"training.cameras", "training.views", "training.static_every"},
    "rigid": {"hair.dynamic"},
    "head-collision": {"training.body_collision"},
    "no-reach": {"training.weights.reach"},
}


def flat(value: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    settings: dict[str, Any] = {}
    for name, item in value.items():
        settings |= flat(item, f"{prefix}{name}.") if isinstance(item, dict) else {prefix + name: item}
    return settings


OF_THE_PAPERS_DEFORMER = ("pose", "no-film", "mlp-encoder", "no-elastic")


@pytest.mark.parametrize("name", ABLATIONS)
def test_an_ablation_changes_what_it_says(name: AblationName) -> None:
    base = with_deformer(preset("small"), "paper" if name in OF_THE_PAPERS_DEFORMER else "strands")
    full, without = (flat(dataclasses.asdict(config)) for config in (base, ablated(base, name)))
    assert {setting for setting in full if full[setting] != without[setting]} == CHANGES[name]


@pytest.mark.parametrize("name", OF_THE_PAPERS_DEFORMER)
def test_other_hair_has_no_part_of_the_papers_deformer(name: AblationName) -> None:
    assert ablated(preset("small"), name) == preset("small")


def test_only_dynamics_are_taught() -> None:
    base = with_deformer(preset("small"), "modal")
    assert ablated(base, "untaught") == base


def test_every_ablation_is_known() -> None:
    assert set(CHANGES) == set(ABLATIONS)
    assert ablated(preset("small"), None) == preset("small")
