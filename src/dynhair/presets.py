"""The presets: configurations for a first look, for a laptop, for a night, and the paper's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from dynhair.config import (
    HISTORIES,
    Config,
    DeformerConfig,
    DeformerKind,
    HairConfig,
    HeadConfig,
    LearningRates,
    LossWeights,
    MeshHeadConfig,
    StaticConfig,
    StaticWeights,
    TrainingConfig,
    read_config,
    with_deformer,
)
from dynhair.errors import DynhairError

_SUPPLEMENT = LossWeights(perceptual=0.1, perceptual_raised=0.6)
# By measurement on images alone: more orientation and elasticity help a motion that training does not see; with reach
# and more penetration a single frame can be fitted to a hair IoU of 0.86, and to 0.83 without, for its hair lies on the
# shoulders and not behind them.
_MEASURED = dataclasses.replace(
    _SUPPLEMENT, orientation=5.0, elastic=200_000.0, penetration=1000.0, reach=500.0, settling=10.0
)
# With a training motion held out, 1,000 steps: its hair IoU was 0.757 at the default rates, 0.769 at these, and 0.766
# at two to three times these, where the other motions gained.
_RATES = LearningRates(deformer=3e-3, modes=1e-2)

PRESETS: Mapping[str, Config] = {
    "tiny": Config(
        hair=HairConfig(
            strands=600,
            points=24,
            deformer=DeformerConfig("strands", HISTORIES["strands"], guides=60, width=64, turn=True, inextensible=True),
        ),
        static=StaticConfig(encoder_iterations=20, style_generations=8, iterations=250),
        mesh=MeshHeadConfig(resolution=32, iterations=150),
        head=HeadConfig(gaussians=8000, mouth_gaussians=300, features=16, deformation_width=48, appearance_width=16),
        training=TrainingConfig(
            iterations=1200,
            checkpoint_every=300,
            preview_every=300,
            weights=LossWeights(penetration=1000.0, settling=10.0),
            # so short a static stage leaves strands astray: at the other presets' rate, hair IoU on the demo's training
            # motions is 0.83 in the place of 0.88
            rates=dataclasses.replace(_RATES, strands=5e-4),
        ),
    ),
    "small": Config(
        hair=HairConfig(
            strands=3000,
            deformer=DeformerConfig(
                "strands", HISTORIES["strands"], turn=True, position_frequencies=3, inextensible=True
            ),
        ),
        training=TrainingConfig(iterations=12_000, checkpoint_every=1000, weights=_MEASURED, rates=_RATES),
    ),
    "medium": Config(
        hair=HairConfig(
            strands=5000,
            points=40,
            deformer=DeformerConfig(
                "strands",
                HISTORIES["strands"],
                guides=250,
                turn=True,
                position_frequencies=3,
                knots=12,
                inextensible=True,
            ),
        ),
        static=StaticConfig(encoder_iterations=400, iterations=4000, views=4, weights=StaticWeights(perceptual=0.01)),
        head=HeadConfig(
            gaussians=60_000, mouth_gaussians=1500, features=64, deformation_width=128, appearance_width=64
        ),
        training=TrainingConfig(
            iterations=40_000, views=4, image_size=512, checkpoint_every=1000, weights=_MEASURED, rates=_RATES
        ),
    ),
    "paper": Config(
        hair=HairConfig(strands=11_000, points=40, deformer=DeformerConfig(hidden=256, width=256, layers=4, knots=0)),
        static=StaticConfig(
            encoder_iterations=1200,
            iterations=5000,
            views=4,
            image_size=1024,
            weights=StaticWeights(perceptual=0.01, segmentation_excess=0.5),
        ),
        mesh=MeshHeadConfig(
            resolution=88, width=256, views=4, iterations=20_000, network_rate=1e-3, checkpoint_every=1000
        ),
        head=HeadConfig(
            start="mesh",
            gaussians=140_000,
            mouth_gaussians=3000,
            features=128,
            deformation_width=256,
            deformation_layers=5,
            appearance_width=256,
        ),
        training=TrainingConfig(
            iterations=320_000,
            views=4,
            image_size=1024,
            penetration_points=10_000,
            perceptual_every=1,
            perceptual_crop=256,
            checkpoint_every=2000,
            weights=_SUPPLEMENT,
        ),
    ),
}


def preset(name: str) -> Config:
    """The preset of that name.

    Raises:
        DynhairError: there is none.
    """
    if name not in PRESETS:
        raise DynhairError(f"there is no preset '{name}'", expected=f"one of {', '.join(PRESETS)}")
    return PRESETS[name]


def chosen_config(
    name: str,
    file: Path | None,
    iterations: int | None,
    seed: int | None,
    deformer: DeformerKind | None = None,
) -> Config:
    """A preset, or the configuration in a file, with other iterations, seed, kind of deformer where they are given."""
    config = preset(name) if file is None else read_config(file)
    if deformer is not None:
        config = with_deformer(config, deformer)
    training = config.training
    training = dataclasses.replace(
        training,
        iterations=training.iterations if iterations is None else iterations,
        seed=training.seed if seed is None else seed,
    )
    return dataclasses.replace(config, training=training)
