"""What is compared: our method, ours without a part, and others', by name, with their names in tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Literal, cast

from dynhair.ablations import ABLATIONS, AblationName, ablated
from dynhair.config import Config

MethodName = Literal["ours", "rigid", "gha", "ga", "simulator", "simulator-tuned"]

BASELINES: frozenset[str] = frozenset({"gha", "ga", "simulator", "simulator-tuned"})
SIMULATORS: frozenset[str] = frozenset({"simulator", "simulator-tuned"})
FULL = "full"
HAIR = "hair"
"""The canonical hair that the rows of one seed share; a row of the plan, none of the tables."""

LABELS: Mapping[str, str] = {
    "ours": "Ours",
    "gha": "GHA",
    "ga": "GA",
    "simulator": "Simulator",
    "simulator-tuned": "Simulator, tuned",
    "rigid": "Rigid hair",
    "paper-deformer": "w/ the paper's deformer",
    "modal-deformer": "w/ modes",
    "untaught": "w/o taught dynamics",
    "pose": "w/ pose",
    "no-acceleration": "w/o acceleration",
    "no-gravity": "w/o gravity",
    "no-turn": "w/o turn",
    "no-elastic": "w/o elastic term",
    "stretching": "w/ strands that stretch",
    "no-film": "w/o FiLM",
    "mlp-encoder": "w/ MLP encoder",
    "no-colour-terms": "w/o colour terms",
    "no-raised-perceptual": "w/o raised perceptual weight",
    "one-view": "1 view",
    "head-collision": "w/o body collision",
    "no-reach": "w/o reach term",
    HAIR: "Canonical hair",
}


def row_name(name: str, seed: int) -> str:
    """The name of a row, which is that of its folder: the same whichever other rows and seeds there are."""
    return f"{name}-seed{seed}"


def method_config(base: Config, method: str, seed: int) -> Config:
    """The configuration of one row: the common one with the row's seed and, of an ablation, without a part.

    Args:
        base: what all rows have in common.
        method: ours, an ablation, a baseline, or the shared hair.
        seed: of everything random.
    """
    config = dataclasses.replace(base, training=dataclasses.replace(base.training, seed=seed))
    return ablated(config, cast(AblationName, method)) if method in ABLATIONS else config


def changes_nothing(base: Config, ablation: AblationName) -> bool:
    """Whether a configuration does not have the part that an ablation takes away."""
    return ablated(base, ablation) == base
